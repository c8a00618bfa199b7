"""Collisions, de-duplicated (protocol 7.2), with the penalty factors of protocol 7.1."""

from dataclasses import replace
from types import MappingProxyType

from mdrive_sumo.core import portable
from mdrive_sumo.core.state import TICKS_PER_SECOND, Kind
from mdrive_sumo.scoring.metrics.ego_track import EgoTrack, InfractionEvent
from mdrive_sumo.scoring.metrics.metric import InfractionMetric

SAME_ACTOR_TICKS = 5 * TICKS_PER_SECOND
"""Ticks after the last counted collision, of any kind, in which contacts with the last actor are ignored."""
SAME_PLACE_M = 3.0
"""Contacts nearer than this [m] to an earlier collision are ignored."""
FORGET_PLACE_M = 5.0
"""An earlier collision is forgotten once the CAV is further away than this [m]."""

INFRACTION_BY_KIND = MappingProxyType(
    {
        Kind.PEDESTRIAN: ("collision-pedestrian", 0.50),
        Kind.VEHICLE: ("collision-vehicle", 0.60),
        Kind.CYCLIST: ("collision-vehicle", 0.60),
        Kind.STATIC: ("collision-static", 0.65),
    }
)
"""Infraction and penalty factor by kind of the other. The original treats a cyclist as a vehicle, by CARLA's types."""


class _CollisionFilter:
    """The memory of the original's collision sensor of one CAV: last actor, last time, places.

    The time is that of the last counted collision, whatever was hit; the actor is that of the last one with an actor.
    So a wall that is hit within 5 s of a vehicle renews the memory of the vehicle (protocol 7.2).
    """

    def __init__(self) -> None:
        self._places: list[tuple[float, float]] = []
        self._actor, self._tick = "", 0

    def forget_old_actor(self, tick: int) -> None:
        """Forget the last actor if the last counted collision lies more than 5 s before `tick`."""
        if tick - self._tick > SAME_ACTOR_TICKS:
            self._actor = ""

    def is_new(self, other: str, tick: int, x: float, y: float) -> bool:
        """Return whether a contact with `other` at (x, y) [m] is a new collision, and remember it if so."""
        if other and other == self._actor:
            return False
        if any(portable.hypot(x - px, y - py) <= SAME_PLACE_M for px, py in self._places):
            return False
        self._places.append((x, y))
        self._tick = tick
        self._actor = other or self._actor
        return True

    def forget_distant_places(self, x: float, y: float) -> None:
        """Forget the collisions far from (x, y) [m], the position of the CAV."""
        self._places = [p for p in self._places if portable.hypot(x - p[0], y - p[1]) <= FORGET_PLACE_M]


def find_collisions(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return the collisions of a CAV: continued contact, or contact again at the same place, is one collision.

    Ignored are contacts with the last actor that was hit, until more than 5 s have passed since the last counted
    collision of any kind; and contacts within 3 m of an earlier collision, whose place is forgotten once the CAV is
    over 5 m away. The map ("") is never the "last actor", but hitting it counts as a collision of any kind. Places are
    box centres of the CAV.
    """
    contacts_by_tick: dict[int, list[tuple[str, Kind]]] = {}
    for tick, contact in track.episode.contacts:
        if contact.ego == track.ego.id:
            contacts_by_tick.setdefault(tick, []).append((contact.other, contact.kind))
    counted: list[InfractionEvent] = []
    collision_filter = _CollisionFilter()
    # Between two contacts the CAV may leave a place and return, hence every tick and not only those with contacts.
    for tick, (x, y) in enumerate(track.xy.tolist()) if contacts_by_tick else ():
        collision_filter.forget_old_actor(tick)
        for other, kind in contacts_by_tick.get(tick, ()):
            if collision_filter.is_new(other, tick, x, y):
                name, factor = INFRACTION_BY_KIND[kind]
                event = track.make_infraction(name, tick, other, factor)
                counted.append(replace(event, impact_speed=compute_impact_speed(track, tick, other)))
        collision_filter.forget_distant_places(x, y)
    return tuple(counted)


COLLISIONS = InfractionMetric("collisions", find_collisions)


def compute_impact_speed(track: EgoTrack, tick: int, other: str) -> float:
    """Return the relative speed [m/s] of the CAV and another road user in the tick before their contact in `tick`.

    The frame of the contact itself is recorded after the impulse (decision 022). other: "" is a building, which stands.
    A road user that enters the world in the tick of the contact has its velocity of that tick.
    """
    before = max(tick - 1, 0)
    own = _compute_velocity(float(track.speed[before]), float(track.yaw[before]))
    episode = track.episode
    if other not in episode.ids:
        return portable.hypot(*own)
    column = episode.ids.index(other)
    then = before if episode.valid[before, column] else tick
    theirs = _compute_velocity(float(episode.speed[then, column]), float(episode.yaw[then, column]))
    return portable.hypot(own[0] - theirs[0], own[1] - theirs[1])


def _compute_velocity(speed: float, yaw: float) -> tuple[float, float]:
    return speed * portable.cos(yaw), speed * portable.sin(yaw)
