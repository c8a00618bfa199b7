"""What is measured of a map and its network: distance of centre lines, observed speeds, side of the traffic."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.geometry import Float, Int, Polyline
from mdrive_sumo.roads import RoadMap
from real2sim.hdmap import LaneKind, MapLane
from real2sim.net_lanes import shapes

SPACING_M = 1.0
ALONG = np.radians(60)
OPPOSED_M = (2.0, 7.0)
"""Lateral distance [m] of the lane for oncoming traffic."""
OPPOSED_YAW = np.radians(160)
ON_LANE_M = 1.5
FASTEST_SHARE = 95
FEWEST_SAMPLES = 10


@dataclass(frozen=True)
class Fit:
    """Distances [m] between centre lines: from points of the source to the network, and back."""

    mean: float
    p95: float
    max: float
    back_mean: float
    back_p95: float
    back_max: float


def measure_fit(source: Sequence[Polyline], roads: RoadMap) -> Fit:
    """Every metre of all source lanes against the nearest lane of the same direction in the network, and back."""
    ours = [lane.centre for lane in roads.driving]
    there, back = line_distances(source, ours), line_distances(ours, source)
    return Fit(*_figures(there), *_figures(back))


def _figures(distance: Float) -> tuple[float, float, float]:
    return float(distance.mean()), float(np.percentile(distance, 95)), float(distance.max())


def line_distances(lines: Sequence[Polyline], others: Sequence[Polyline]) -> Float:
    """Distance (M,) [m] of points every metre on `lines` to the nearest of `others` within 60 degrees.

    Where none runs in that direction nearby (within 20 m) the distance counts as 20 m.
    """
    stations = [line.stations(SPACING_M) for line in lines]
    xy = np.concatenate([_points(line, s) for line, s in zip(lines, stations, strict=True)])
    yaw = np.concatenate([line.yaws_at(s) for line, s in zip(lines, stations, strict=True)])
    drawn = shapes(others)
    tree, points = shapely.STRtree(drawn), shapely.points(xy)
    best = np.full(len(xy), 20.0)
    open_ = np.arange(len(xy))
    for reach in (1.0, 20.0):
        point, other = tree.query(points[open_], predicate="dwithin", distance=reach)
        point = open_[point]
        along = _turn(others, drawn, points, point, other, yaw) <= ALONG
        np.minimum.at(best, point[along], shapely.distance(points[point[along]], drawn[other[along]]))
        open_ = np.flatnonzero(best > reach)
    return best


def _points(line: Polyline, stations: Float) -> Float:
    return np.column_stack([np.interp(stations, line.s, line.xy[:, axis]) for axis in (0, 1)])


def _turn(others: Sequence[Polyline], drawn: Any, points: Any, point: Int, other: Int, yaw: Float) -> Float:
    at = shapely.line_locate_point(drawn[other], points[point])
    turn = np.empty(len(other))
    for i in np.unique(other):
        rows = other == i
        turn[rows] = np.abs(np.angle(np.exp(1j * (others[i].yaws_at(at[rows]) - yaw[point[rows]]))))
    return turn


def observed_speeds(lanes: Mapping[str, MapLane], motions: Sequence[Float], dt_s: float) -> dict[str, float]:
    """95th percentile [m/s] of the speeds on each lane with enough samples."""
    driving = {id_: lane for id_, lane in lanes.items() if lane.kind is LaneKind.DRIVING}
    steps = [np.diff(motion[:, :2], axis=0) for motion in motions] or [np.zeros((0, 2))]
    speed = np.hypot(*np.concatenate(steps).T) / dt_s
    xy = np.concatenate([motion[1:, :2] for motion in motions]) if motions else np.zeros((0, 2))
    known = np.isfinite(speed)
    speed, points = speed[known], shapely.points(xy[known])
    drawn = shapes(Polyline(lane.centre) for lane in driving.values())
    point, lane = shapely.STRtree(drawn).query(points, predicate="dwithin", distance=ON_LANE_M)
    return {
        id_: float(np.percentile(speed[point[lane == i]], FASTEST_SHARE))
        for i, id_ in enumerate(driving)
        if (lane == i).sum() >= FEWEST_SAMPLES
    }


def traffic_side(lanes: Mapping[str, MapLane], voted: Mapping[str, int]) -> bool:
    """Whether traffic keeps to the left: whether most oncoming lanes lie to the right. Lanes are directed by now.

    Lanes with observed motion decide alone if there are any with an oncoming lane; else all directed ones do.
    """
    driving = {id_: lane for id_, lane in lanes.items() if lane.kind is LaneKind.DRIVING and not lane.junction}
    lines = {id_: Polyline(lane.centre) for id_, lane in driving.items()}
    tree, ids = shapely.STRtree(shapes(lines.values())), list(lines)
    balance = {id_: _oncoming(id_, lines, ids, tree) for id_ in ids}
    seen = sum(side for id_, side in balance.items() if id_ in voted)
    return (seen or sum(balance.values())) < 0


def _oncoming(id_: str, lines: Mapping[str, Polyline], ids: Sequence[str], tree: shapely.STRtree) -> float:
    """Length [m] along which the nearest oncoming lane lies to the left, minus that to the right."""
    line = lines[id_]
    balance = 0.0
    for s in np.arange(2.5, line.length, 5.0):
        x, y = line.at(s)
        yaw = line.yaw_at(s)
        nearest = OPPOSED_M[1]
        side = 0.0
        for j in tree.query(shapely.Point(x, y), predicate="dwithin", distance=OPPOSED_M[1]):
            other = lines[ids[j]]
            at, _ = other.project(x, y)
            foot = other.at(at)
            left = (foot[1] - y) * np.cos(yaw) - (foot[0] - x) * np.sin(yaw)
            turn = abs(np.angle(np.exp(1j * (other.yaw_at(at) - yaw))))
            if turn >= OPPOSED_YAW and OPPOSED_M[0] <= abs(left) < nearest:
                nearest, side = abs(left), np.sign(left)
        balance += 5.0 * side
    return float(balance)
