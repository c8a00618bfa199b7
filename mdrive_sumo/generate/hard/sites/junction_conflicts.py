"""Pairs of ways that cross or join in a junction, who gives way, and how long before it drivers see each other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from typing import TypeVar

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, box_corners, wrap_angle
from mdrive_sumo.generate.hard.sites.junction_ways import JunctionWay, compute_timing, find_junction_ways
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


@lru_cache(maxsize=128)
def _build_tree(roads: RoadMap) -> shapely.STRtree:
    """Return the buildings of a place, and what else blocks sight there, as a tree."""
    return shapely.STRtree(roads.building_shapes)


def compute_seen_s(roads: RoadMap, conflict: JunctionConflict) -> float:
    """Return how long [s] before they meet two cars that drive at the limits see each other without a break: any
    corner or the centre of one from the centre of the other, past buildings; at most `SIGHT_S`."""
    times = np.arange(0.0, SIGHT_S + SIGHT_STEP_S / 2, SIGHT_STEP_S)
    eyes, _ = _locate(roads, conflict.own, conflict.own_m, times)
    centres, yaws = _locate(roads, conflict.other, conflict.other_m, times)
    corners = np.array(
        [box_corners(x, y, yaw, CAR.length, CAR.width) for (x, y), yaw in zip(centres, yaws, strict=True)]
    )
    targets = np.concatenate((centres[None], corners.transpose(1, 0, 2)))
    ends = np.stack((np.broadcast_to(eyes, targets.shape), targets), axis=2)
    lines = np.asarray(shapely.linestrings(ends.reshape(-1, 2, 2)))
    interrupted = np.zeros(len(lines), dtype=np.bool_)
    interrupted[np.unique(_build_tree(roads).query(lines, predicate="intersects")[0])] = True
    hidden = np.flatnonzero(interrupted.reshape(len(targets), -1).all(axis=0))
    return float(times[hidden[0]]) if len(hidden) else SIGHT_S


def _locate(roads: RoadMap, way: JunctionWay, station: float, before: Float) -> tuple[Float, Float]:
    """Return the positions (N, 2) [m] and directions (N,) [rad] of a car at times [s] before it reaches a station."""
    line, timing = build_route_line(roads, way.lanes), compute_timing(roads, way.lanes)
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
