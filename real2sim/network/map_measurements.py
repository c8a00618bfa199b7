"""Measurements of a map and its network: centre line deviation, observed speeds, side of traffic."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.roads import RoadMap
from real2sim.hd_map import LaneKind, MapLane
from real2sim.polylines import PolylineIndex, compute_angles_between, sample_polylines

SPACING_M = 1.0
"""[m] Centre lines are compared at points of this distance."""
SEARCH_RANGE_M = 20.0
"""[m] Lines further away are not searched for; a point without any line counts as this far off."""
SAME_DIRECTION_RAD = np.radians(60)
"""A lane at a larger angle crosses or comes towards that of the source: it is not its image."""
ONCOMING_OFFSET_M = (2.0, 7.0)
"""Lateral distance [m] of the oncoming lane."""
ONCOMING_SPACING_M = 5.0
"""[m] Distance between the points that look for an oncoming lane."""
ONCOMING_RAD = np.radians(160)
"""An oncoming lane is at least this far from the own direction: opposite, with room for bends."""
ON_LANE_M = 1.5
"""[m] A vehicle this near to a centre line drives on that lane: less than half a lane width."""
SPEED_PERCENTILE = 95
"""The speed of a lane is this percentile: the highest ones are errors of tracking."""
MIN_SPEED_SAMPLES = 10
"""Chosen: fewer samples say nothing about the limit of a lane."""


@dataclass(frozen=True)
class MapDeviation:
    """Distances [m] between centre lines: from points of the source to the network, and back."""

    mean: float
    p95: float
    max: float
    back_mean: float
    back_p95: float
    back_max: float


def measure_centreline_deviation(source: Sequence[Polyline], roads: RoadMap) -> MapDeviation:
    """Measure every metre of all source lanes against the nearest lane with the same direction, and back."""
    ours = [lane.centre for lane in roads.driving]
    there, back = measure_line_distances(source, ours), measure_line_distances(ours, source)
    return MapDeviation(*_summarise(there), *_summarise(back))


def _summarise(distance: Float) -> tuple[float, float, float]:
    return float(distance.mean()), float(np.percentile(distance, 95)), float(distance.max())


def measure_line_distances(lines: Sequence[Polyline], others: Sequence[Polyline]) -> Float:
    """Return distances (M,) [m] from points every metre on `lines` to the nearest of `others` within 60 degrees.

    Points without such a line within `SEARCH_RANGE_M` count as `SEARCH_RANGE_M`.
    """
    points, index = sample_polylines(lines, SPACING_M), PolylineIndex(others)
    best = np.full(len(points.xy), SEARCH_RANGE_M)
    open_ = np.arange(len(best))
    for reach in (1.0, SEARCH_RANGE_M):  # most points are near, and the wide search is expensive
        feet = index.project_points(points.xy[open_], reach)
        point = open_[feet.point]
        along = compute_angles_between(feet.yaw, points.yaw[point]) <= SAME_DIRECTION_RAD
        np.minimum.at(best, point[along], feet.distance[along])
        open_ = np.flatnonzero(best > reach)
    return best


def measure_observed_speeds(lanes: Mapping[str, MapLane], motions: Sequence[Float], dt_s: float) -> dict[str, float]:
    """Return the 95th percentile [m/s] of the speeds on each lane with enough samples."""
    driving = {id_: lane for id_, lane in lanes.items() if lane.kind is LaneKind.DRIVING}
    steps = [np.diff(motion[:, :2], axis=0) for motion in motions] or [np.zeros((0, 2))]
    speed = np.hypot(*np.concatenate(steps).T) / dt_s
    xy = np.concatenate([motion[1:, :2] for motion in motions]) if motions else np.zeros((0, 2))
    measured = np.isfinite(speed)
    speed = speed[measured]
    feet = PolylineIndex([Polyline(lane.centre) for lane in driving.values()]).project_points(xy[measured], ON_LANE_M)
    return {
        id_: float(np.percentile(speed[feet.point[feet.line == i]], SPEED_PERCENTILE))
        for i, id_ in enumerate(driving)
        if (feet.line == i).sum() >= MIN_SPEED_SAMPLES
    }


def is_left_hand_traffic(lanes: Mapping[str, MapLane], voted: Mapping[str, int]) -> bool:
    """Return whether most oncoming lanes lie to the right. Lanes must be directed.

    Lanes with observed motion decide alone if any of them has an oncoming lane; otherwise all lanes do.
    """
    ids = [id_ for id_, lane in lanes.items() if lane.kind is LaneKind.DRIVING and not lane.junction]
    if not ids:
        return False
    lines = [Polyline(lanes[id_].centre) for id_ in ids]
    points = sample_polylines(lines, ONCOMING_SPACING_M)
    feet = PolylineIndex(lines).project_points(points.xy, ONCOMING_OFFSET_M[1])
    oncoming = compute_angles_between(feet.yaw, points.yaw[feet.point]) >= ONCOMING_RAD
    rows = np.flatnonzero(oncoming & (np.abs(feet.lateral) >= ONCOMING_OFFSET_M[0]))
    rows = rows[np.lexsort((np.abs(feet.lateral[rows]), feet.point[rows]))]
    rows = rows[np.unique(feet.point[rows], return_index=True)[1]]  # the nearest of each point
    side = -np.sign(feet.lateral[rows])  # `lateral` refers to the direction of the oncoming lane
    seen = np.array([id_ in voted for id_ in ids])[points.line[feet.point[rows]]]
    return bool((float(side[seen].sum()) or float(side.sum())) < 0)
