"""Collisions, de-duplicated (protocol 7.2)."""

import math
from types import MappingProxyType

from mdrive_sumo.core.state import TICKS_PER_SECOND, Kind
from mdrive_sumo.scoring.metrics.ego_track import Track
from mdrive_sumo.scoring.metrics.infraction import Infraction

SAME_ACTOR_TICKS = 5 * TICKS_PER_SECOND
SAME_PLACE_M = 3.0
FORGET_PLACE_M = 5.0

KINDS = MappingProxyType(
    {
        Kind.PEDESTRIAN: "collision-pedestrian",
        Kind.VEHICLE: "collision-vehicle",
        Kind.CYCLIST: "collision-vehicle",
        Kind.STATIC: "collision-static",
    }
)
"""A cyclist is a vehicle to the original, which goes by CARLA's type names."""


class _Sensor:
    """What the original's collision sensor of one CAV remembers."""

    def __init__(self) -> None:
        self._places: list[tuple[float, float]] = []
        self._actor, self._tick = "", 0

    def counts(self, other: str, tick: int, x: float, y: float) -> bool:
        """Whether a hit on `other` at (x, y) [m] is a new collision; it is remembered if so."""
        if other and other == self._actor and tick - self._tick <= SAME_ACTOR_TICKS:
            return False
        if any(math.hypot(x - px, y - py) <= SAME_PLACE_M for px, py in self._places):
            return False
        self._places.append((x, y))
        if other:
            self._actor, self._tick = other, tick
        return True

    def leave(self, x: float, y: float) -> None:
        """Forgets the places that are far from (x, y) [m], where the CAV is now."""
        self._places = [p for p in self._places if math.hypot(x - p[0], y - p[1]) <= FORGET_PLACE_M]


def collisions(track: Track) -> tuple[Infraction, ...]:
    """Collisions that count: touching the same thing on, or again at the same place, is one collision.

    Ignored are a hit on the actor of the last counted hit until more than 5 s have passed since that one, and
    any hit within 3 m of where an earlier one was counted; such a place is forgotten once the CAV is over 5 m
    away from it. The map ("") is never the "last actor". Places are box centres of the CAV itself.
    """
    hits: dict[int, list[tuple[str, Kind]]] = {}
    for tick, contact in track.episode.contacts:
        if contact.ego == track.ego.id:
            hits.setdefault(tick, []).append((contact.other, contact.kind))
    counted: list[Infraction] = []
    sensor = _Sensor()
    # Between two hits the CAV may leave a place and come back, hence every tick and not the hits alone.
    for tick, (x, y) in enumerate(track.xy.tolist()) if hits else ():
        for other, kind in hits.get(tick, ()):
            if sensor.counts(other, tick, x, y):
                counted.append(track.event(KINDS[kind], tick, other))
        sensor.leave(x, y)
    return tuple(counted)
