"""Dense route (1 m) along matched legs. Lane changes begin as early as possible, as in CARLA's planner."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from mdrive_sumo.roads import Lane, RoadMap, Route, join_route_pieces
from real2sim.match.waypoint_matcher import RouteLeg

CHANGE_M = 5.0
"""Length of a change over one lane, if there is room: five 1 m points, as in CARLA's GlobalRoutePlanner."""
SAMPLE_M = 0.25
END_SKEW_M = 5.0
"""[m] Longitudinal offset allowed between the ends of neighbouring lanes."""

RoutePiece = tuple[Float, Float]
"""Points (M, 2) [m] and lane directions (M,) [rad]."""


@dataclass(frozen=True, slots=True)
class _LaneRun:
    """Consecutive lanes, and the number of lane changes at their beginning."""

    changes: int
    lanes: tuple[Lane, ...]


def compute_start_pose(roads: RoadMap, legs: Sequence[RouteLeg]) -> tuple[float, float, float]:
    """Return x, y [m] of the start on the centre line of the first lane, and the direction of the lane [rad]."""
    centre = roads.lanes[legs[0].lanes[0]].centre
    return (*centre.at(legs[0].start_s), centre.yaw_at(legs[0].start_s))


def build_dense_route(roads: RoadMap, legs: Sequence[RouteLeg]) -> Route:
    """Build the dense route along consecutive legs."""
    pieces = [piece for leg in legs for piece in _build_leg_pieces(roads, leg)]
    return join_route_pieces(legs[0].lanes + tuple(lane for leg in legs[1:] for lane in leg.lanes[1:]), pieces)


def _build_leg_pieces(roads: RoadMap, leg: RouteLeg) -> Iterator[RoutePiece]:
    drives = _split_at_lane_changes([roads.lanes[lane] for lane in leg.lanes])
    here = roads.lanes[leg.lanes[0]].centre.at(leg.start_s)
    for drive in drives:
        path = build_polyline(np.concatenate([lane.centre.xy for lane in drive.lanes]))
        rest = drive.lanes[-1].centre.length - leg.goal_s if drive is drives[-1] else 0.0
        start, aside = path.project(*here, between=(0.0, drive.lanes[0].centre.length + END_SKEW_M))
        end = max(path.length - rest, start)
        yield _build_lane_change(path, (start, end), aside, CHANGE_M * drive.changes)
        here = path.at(end)


def _split_at_lane_changes(lanes: Sequence[Lane]) -> list[_LaneRun]:
    """Split a leg where it changes lanes; a lane is left at its beginning."""
    drives: list[_LaneRun] = []
    changes, chain = 0, [lanes[0]]
    for before, lane in pairwise(lanes):
        if lane.id not in (before.left, before.right):
            chain.append(lane)
            continue
        if len(chain) > 1:
            drives.append(_LaneRun(changes, tuple(chain[:-1])))
            changes = 0
        changes, chain = changes + 1, [lane]
    return [*drives, _LaneRun(changes, tuple(chain))]


def _build_lane_change(path: Polyline, between: tuple[float, float], aside: float, room: float) -> RoutePiece:
    """Follow the path, from `aside` [m] (positive: left) onto it within `room` [m] with a smoothstep."""
    start, end = between
    stations = np.linspace(start, end, max(int((end - start) / SAMPLE_M), 1) + 1)
    xy = np.array([path.at(s) for s in stations])
    yaw = np.array([path.yaw_at(s) for s in stations])
    share = np.clip((stations - start) / max(min(room, end - start), 1e-6), 0.0, 1.0)
    offset = aside * (1 - share**2 * (3 - 2 * share))
    return xy + offset[:, None] * np.column_stack((-np.sin(yaw), np.cos(yaw))), yaw
