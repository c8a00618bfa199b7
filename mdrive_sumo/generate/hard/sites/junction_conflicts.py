"""Pairs of ways that cross or join in a junction, who gives way, and how long before it drivers see each other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from typing import TypeVar

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, box_corners, wrap_angle
from mdrive_sumo.generate.hard.sites.junction_ways import JunctionWay, WayTiming, compute_timing, find_junction_ways
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.placement.lane_chains import MEETING_M, build_route_line

Site = TypeVar("Site")
SIGHT_S, SIGHT_STEP_S = 6.0, 0.1
"""[s] Sight is computed for that time before two vehicles meet, in such steps: a car of 50 km/h is then 83 m away."""


@dataclass(frozen=True, slots=True)
class JunctionConflict:
    """Two ways from different approaches that come together in a junction."""

    own: JunctionWay
    other: JunctionWay
    own_m: float
    """Station [m] on `own` at which it first comes together with the other way."""
    other_m: float
    """Station [m] of the same place on `other`."""
    is_crossing: bool
    """Whether the ways part again; others join."""
    from_left: bool
    """Whether the other way comes from the left of the own one."""


@lru_cache(maxsize=128)
def find_junction_conflicts(roads: RoadMap) -> tuple[JunctionConflict, ...]:
    """Return all ordered pairs of ways that meet in a junction, in the order of `find_junction_ways`."""
    ways = sorted(find_junction_ways(roads), key=lambda way: way.junction)
    return tuple(
        conflict
        for _, group in groupby(ways, key=lambda way: way.junction)
        for conflict in _pair_ways(roads, list(group))
    )


def _pair_ways(roads: RoadMap, ways: Sequence[JunctionWay]) -> Iterator[JunctionConflict]:
    points = [_list_points(roads, way) for way in ways]
    for i, own in enumerate(ways):
        for j, other in enumerate(ways):
            if roads.lanes[own.approach].edge == roads.lanes[other.approach].edge:
                continue
            away = portable.hypot(*(points[i][:, None] - points[j][None]).transpose(2, 0, 1))
            near = np.flatnonzero(away.min(axis=1) < MEETING_M)
            if len(near):
                first = int(near[0])
                yield JunctionConflict(
                    own,
                    other,
                    float(int(own.stop_m) + first),
                    float(int(other.stop_m) + int(away[first].argmin())),
                    own.lanes[-1] != other.lanes[-1] and int(near[-1]) + 1 < len(points[i]),
                    _comes_from_left(roads, own, other),
                )


def _list_points(roads: RoadMap, way: JunctionWay) -> Float:
    """Return the points (N, 2) [m] of a way inside its junction, a metre apart."""
    return build_route_line(roads, way.lanes).xy[int(way.stop_m) : int(way.exit_m) + 2]


def _comes_from_left(roads: RoadMap, own: JunctionWay, other: JunctionWay) -> bool:
    yaws = [roads.lanes[way.approach].centre for way in (own, other)]
    begin, end = (line.yaw_at(line.length) for line in yaws)
    return wrap_angle(end - begin) < 0.0


@dataclass(frozen=True, slots=True)
class Obstacles:
    """What hides road users at a place: its buildings, and boxes that stand on the road."""

    shapes: tuple[shapely.Geometry, ...]

    def find_hidden(self, begins: Float, ends: Float) -> Bool:
        """Return which of the lines (N,) from `begins` to `ends` (N, 2) [m] are interrupted."""
        lines = [shapely.LineString(ends) for ends in zip(begins, ends, strict=True)]
        tree = shapely.STRtree(self.shapes)
        hidden = np.zeros(len(lines), dtype=np.bool_)
        hidden[np.unique(tree.query(lines, predicate="intersects")[0])] = True
        return hidden


def compute_seen_s(
    roads: RoadMap,
    conflict: JunctionConflict,
    shares: tuple[float, float] = (1.0, 1.0),
    boxes: Sequence[shapely.Polygon] = (),
) -> float:
    """Return how long [s] before they meet two cars, at shares of the limits on their ways, see each other without a
    break: any corner or the centre of one from the centre of the other; at most `SIGHT_S`.

    boxes: of vehicles that stand on the road.
    """
    times = np.arange(0.0, SIGHT_S + SIGHT_STEP_S / 2, SIGHT_STEP_S)
    own = compute_timing(roads, conflict.own.lanes, shares[0])
    other = compute_timing(roads, conflict.other.lanes, shares[1])
    eyes, _ = _locate(roads, conflict.own, own, conflict.own_m, times)
    centres, yaws = _locate(roads, conflict.other, other, conflict.other_m, times)
    seen = np.zeros(len(times), dtype=np.bool_)
    obstacles = Obstacles((*roads.building_shapes, *boxes))
    corners = np.array(
        [box_corners(x, y, yaw, CAR.length, CAR.width) for (x, y), yaw in zip(centres, yaws, strict=True)]
    )
    for target in (centres, *corners.transpose(1, 0, 2)):
        seen |= ~obstacles.find_hidden(eyes, target)
    hidden = np.flatnonzero(~seen)
    return float(times[hidden[0]]) if len(hidden) else SIGHT_S


def _locate(roads: RoadMap, way: JunctionWay, timing: WayTiming, station: float, before: Float) -> tuple[Float, Float]:
    """Return the positions (N, 2) [m] and directions (N,) [rad] of a car at times [s] before it reaches a station."""
    line = build_route_line(roads, way.lanes)
    metres = np.arange(len(timing.time))
    due = float(np.interp(station, metres, timing.time))
    stations = np.interp(due - before, timing.time, metres)
    xy = np.column_stack([np.interp(stations, np.arange(len(line.xy)), line.xy[:, k]) for k in (0, 1)])
    return xy, np.interp(stations, np.arange(len(line.yaw)), line.yaw)


def refuse_place(roads: RoadMap, what: str) -> ProposalRejected:
    """Return the rejection of a place that lacks what a family needs."""
    return ProposalRejected(PipelineStage.WAYS, f"network {roads.name}: expected {what}, found none")


def choose_site(sites: Sequence[Site], share: float) -> Site:
    """Return the site at a share in [0, 1] of all."""
    return sites[min(int(share * len(sites)), len(sites) - 1)]
