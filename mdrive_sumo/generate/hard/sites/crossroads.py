"""Crossroads: the ways of two streets that cross, with their right of way; where one ends, its left turn."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.generate.hard.sites.junction_conflicts import (
    JunctionConflict,
    choose_site,
    compute_seen_s,
    find_junction_conflicts,
    refuse_place,
)
from mdrive_sumo.generate.hard.sites.junction_ways import JunctionWay
from mdrive_sumo.roads import RoadMap

OPPOSITE_RAD = math.radians(130.0)
"""Approaches whose directions differ by more face each other."""


@dataclass(frozen=True, slots=True)
class Crossroads:
    """Two streets that cross, seen from one approach."""

    meeting: JunctionConflict
    """The way of that approach, straight on or to the left where its street ends, and one of the other street."""
    back: JunctionConflict | None
    """The way of the opposite approach, and the same one of the other street."""
    far: JunctionConflict | None
    """The way of that approach, and the other street's opposite one."""
    seen_s: float
    """How long before they meet the drivers of `meeting` see each other, at the limits."""

    @property
    def others(self) -> tuple[JunctionConflict, ...]:
        """The conflicts of the way of that approach: with the other street's near way, and its opposite one."""
        return (self.meeting,) if self.far is None else (self.meeting, self.far)


@lru_cache(maxsize=128)
def find_crossroads(roads: RoadMap, controls: tuple[JunctionKind | None, ...]) -> tuple[Crossroads, ...]:
    """Return the crossroads of a place whose first approach has one of these controls, in the order of its ways."""
    conflicts = find_junction_conflicts(roads)
    straight = {one.own.approach for one in conflicts if one.own.turn == "straight"}
    crossings = [
        one
        for one in conflicts
        if one.other.turn == "straight"
        and (one.own.turn == "straight" or (one.own.turn == "left" and one.own.approach not in straight))
        and not are_opposite(roads, one.own, one.other)
    ]
    return tuple(_build_crossroads(roads, crossings, controls))


def _build_crossroads(
    roads: RoadMap, crossings: list[JunctionConflict], controls: tuple[JunctionKind | None, ...]
) -> Iterator[Crossroads]:
    for one in crossings:
        if one.own.control in controls and one.is_crossing:
            back = [x for x in crossings if x.other == one.other and are_opposite(roads, x.own, one.own)]
            far = [x for x in crossings if x.own == one.own and are_opposite(roads, x.other, one.other)]
            yield Crossroads(one, back[0] if back else None, far[0] if far else None, compute_seen_s(roads, one))


def are_opposite(roads: RoadMap, one: JunctionWay, other: JunctionWay) -> bool:
    """Return whether two approaches face each other."""
    first, second = (roads.lanes[way.approach].centre for way in (one, other))
    return abs(wrap_angle(first.yaw_at(first.length) - second.yaw_at(second.length))) > OPPOSITE_RAD


def choose_crossroads(
    roads: RoadMap, share: float, controls: tuple[JunctionKind | None, ...], most_seen_s: float = math.inf
) -> Crossroads:
    """Return the crossroads at a share in [0, 1] of those that fit, the best hidden half of the place's; raise
    ProposalRejected without any.

    most_seen_s: of drivers on both ways, see `Crossroads.seen_s`.
    """
    found = sorted(find_crossroads(roads, controls), key=lambda one: one.seen_s)
    sites = [one for one in found[: (len(found) + 1) // 2] if one.seen_s <= most_seen_s]
    if not sites:
        raise refuse_place(
            roads,
            f"streets that meet ({'/'.join(map(str, controls))}) and see each other at most {most_seen_s:g} s before",
        )
    return choose_site(sites, share)
