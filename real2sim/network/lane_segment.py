"""Lane segments: lanes of an HD map or parts of them, with a direction of travel and an id of their own."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from real2sim.hd_map import LaneKind, MapLane

MIN_LANE_M = 0.5
"""[m] Shorter lanes cannot be driven on and are dropped."""
HEADING_OVER_M = 2.0
"""[m] Length at a lane's end over which its direction is measured: short segments of drawn lanes are noisy."""

LaneLink = tuple[str, str]
"""The segment with the first id leads into the second."""


@dataclass(frozen=True)
class LaneSegment:
    """A lane or a part of one, in its direction of travel."""

    id: str
    source_lane: str
    """Id of the lane of the source map."""
    centreline: Polyline
    width: float
    """Width [m] of the lane; NaN until it is known."""
    speed: float
    """Speed limit [m/s] of the lane."""
    kind: LaneKind
    junction: bool
    group: str = ""

    @property
    def start(self) -> Float:
        """First point (2,) [m]."""
        return self.centreline.xy[0]

    @property
    def end(self) -> Float:
        """Last point (2,) [m]."""
        return self.centreline.xy[-1]

    @property
    def start_yaw(self) -> float:
        """Direction [rad] at the beginning."""
        return compute_chord_yaw(self.centreline, 0.0, HEADING_OVER_M)

    @property
    def end_yaw(self) -> float:
        """Direction [rad] at the end."""
        return compute_chord_yaw(self.centreline, self.centreline.length - HEADING_OVER_M, self.centreline.length)


def compute_chord_yaw(line: Polyline, begin: float, end: float) -> float:
    """Return the direction [rad] from arc length `begin` to `end` [m], both clamped to the line."""
    a, b = line.at(max(begin, 0.0)), line.at(min(end, line.length))
    return float(np.arctan2(b[1] - a[1], b[0] - a[0]))


def compute_yaw_difference(a: float, b: float) -> float:
    """Return the angle [rad] in [0, pi] between two directions."""
    return abs(float(np.angle(np.exp(1j * (a - b)))))


def clip_polyline(line: Polyline, begin: float, end: float) -> Polyline:
    """Return the part of a line between arc lengths `begin` and `end` [m]."""
    inner = line.xy[(line.s > begin + 1e-6) & (line.s < end - 1e-6)]
    return build_polyline(np.concatenate(([line.at(begin)], inner, [line.at(end)])))


def split_segment(segment: LaneSegment, stations: Sequence[float]) -> list[LaneSegment]:
    """Split a segment at ascending arc lengths [m]; parts are named ID~0, ID~1 and so on."""
    if not stations:
        return [segment]
    bounds = [0.0, *stations, segment.centreline.length]
    return [
        replace(segment, id=f"{segment.id}~{k}", centreline=clip_polyline(segment.centreline, bounds[k], bounds[k + 1]))
        for k in range(len(bounds) - 1)
    ]


def split_segments(
    segments: Mapping[str, LaneSegment], links: Iterable[LaneLink], stations: Mapping[str, Sequence[float]]
) -> tuple[dict[str, LaneSegment], set[LaneLink]]:
    """Split all segments and keep their links: links leave from the last part and enter the first."""
    parts = {id_: split_segment(segment, stations.get(id_, ())) for id_, segment in segments.items()}
    made = {(parts[a][-1].id, parts[b][0].id) for a, b in links}
    for chain in parts.values():
        made |= {(a.id, b.id) for a, b in pairwise(chain)}
    return {part.id: part for chain in parts.values() for part in chain}, made


def measure_boundary_width(lane: MapLane) -> float:
    """Return the median distance [m] between the boundaries along the centre line; NaN if one is unknown."""
    if len(lane.left) < 2 or len(lane.right) < 2:
        return float("nan")
    middle = shapely.points(build_polyline(lane.centre).resample(2.0).xy)
    return float(
        np.median(
            shapely.distance(middle, shapely.LineString(lane.left))
            + shapely.distance(middle, shapely.LineString(lane.right))
        )
    )
