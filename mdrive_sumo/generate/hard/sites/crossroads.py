"""Crossroads: the ways of two streets that cross, with their right of way; where one ends, its left turn."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache

from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.generate.hard.sites.junction_conflicts import (
    JunctionConflict,
    find_junction_conflicts,
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
            yield Crossroads(one, back[0] if back else None, far[0] if far else None)


def are_opposite(roads: RoadMap, one: JunctionWay, other: JunctionWay) -> bool:
    """Return whether two approaches face each other."""
    first, second = (roads.lanes[way.approach].centre for way in (one, other))
    return abs(wrap_angle(first.yaw_at(first.length) - second.yaw_at(second.length))) > OPPOSITE_RAD
