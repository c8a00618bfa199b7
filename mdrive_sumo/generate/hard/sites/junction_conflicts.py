"""Pairs of ways that cross or join in a junction, and who gives way."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby
from typing import TypeVar

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, wrap_angle
from mdrive_sumo.generate.hard.sites.junction_ways import JunctionWay, find_junction_ways
from mdrive_sumo.generate.rejection import PipelineStage, ProposalRejected
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.worlds.placement.lane_chains import MEETING_M, build_route_line

Site = TypeVar("Site")


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


def refuse_place(roads: RoadMap, what: str) -> ProposalRejected:
    """Return the rejection of a place that lacks what a family needs."""
    return ProposalRejected(PipelineStage.WAYS, f"network {roads.name}: expected {what}, found none")


def choose_site(sites: Sequence[Site], share: float) -> Site:
    """Return the site at a share in [0, 1] of all."""
    return sites[min(int(share * len(sites)), len(sites) - 1)]
