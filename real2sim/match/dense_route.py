"""The dense 1 m route along matched legs. Lane changes begin as early as they can, as in CARLA's planner."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mdrive_sumo.core.geometry import Float, Polyline, polyline
from mdrive_sumo.roads import Lane, RoadMap, Route, dense_route
from real2sim.match.waypoint_matcher import Leg

CHANGE_M = 5.0
"""Length of the move over one lane, if there is room: five 1 m points, as in CARLA's GlobalRoutePlanner."""
FINE_M = 0.25
END_SKEW_M = 5.0
"""How far the ends of neighbouring lanes may be apart along the road."""

Piece = tuple[Float, Float]
"""Points (M, 2) [m] and lane directions (M,) [rad]."""


@dataclass(frozen=True, slots=True)
class _Drive:
    """Lanes that follow one another, after that many lane changes at their beginning."""

    changes: int
    lanes: tuple[Lane, ...]


def start_pose(roads: RoadMap, legs: Sequence[Leg]) -> tuple[float, float, float]:
    """Where the route begins: x, y [m] on the centre line of its first lane, direction of that lane [rad]."""
    centre = roads.lanes[legs[0].lanes[0]].centre
    return (*centre.at(legs[0].start_s), centre.yaw_at(legs[0].start_s))


def route_of(roads: RoadMap, legs: Sequence[Leg]) -> Route:
    """The dense route along legs that join."""
    pieces = [piece for leg in legs for piece in _leg_pieces(roads, leg)]
    return dense_route(legs[0].lanes + tuple(lane for leg in legs[1:] for lane in leg.lanes[1:]), pieces)


def _leg_pieces(roads: RoadMap, leg: Leg) -> Iterator[Piece]:
    drives = _drives([roads.lanes[lane] for lane in leg.lanes])
    here = roads.lanes[leg.lanes[0]].centre.at(leg.start_s)
    for drive in drives:
        path = polyline(np.concatenate([lane.centre.xy for lane in drive.lanes]))
        rest = drive.lanes[-1].centre.length - leg.goal_s if drive is drives[-1] else 0.0
        start, aside = path.project(*here, between=(0.0, drive.lanes[0].centre.length + END_SKEW_M))
        end = max(path.length - rest, start)
        yield _moving_over(path, (start, end), aside, CHANGE_M * drive.changes)
        here = path.at(end)


def _drives(lanes: Sequence[Lane]) -> list[_Drive]:
    """Splits a leg where it changes lanes; a lane is left at its beginning."""
    drives: list[_Drive] = []
    changes, chain = 0, [lanes[0]]
    for before, lane in pairwise(lanes):
        if lane.id not in (before.left, before.right):
            chain.append(lane)
            continue
        if len(chain) > 1:
            drives.append(_Drive(changes, tuple(chain[:-1])))
            changes = 0
        changes, chain = changes + 1, [lane]
    return [*drives, _Drive(changes, tuple(chain))]


def _moving_over(path: Polyline, between: tuple[float, float], aside: float, room: float) -> Piece:
    """Along the path, from `aside` [m] (positive: left) onto it within `room` [m], on a smoothstep."""
    start, end = between
    stations = np.linspace(start, end, max(int((end - start) / FINE_M), 1) + 1)
    xy = np.array([path.at(s) for s in stations])
    yaw = np.array([path.yaw_at(s) for s in stations])
    share = np.clip((stations - start) / max(min(room, end - start), 1e-6), 0.0, 1.0)
    offset = aside * (1 - share**2 * (3 - 2 * share))
    return xy + offset[:, None] * np.column_stack((-np.sin(yaw), np.cos(yaw))), yaw
