"""Collisions, de-duplicated (protocol 7.2), with the penalty factors of protocol 7.1."""

from bisect import bisect_left, bisect_right
from dataclasses import replace
from types import MappingProxyType

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float
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


@twin
def find_new_contacts(xy: Float, ticks: list[int], others: list[str], /) -> list[int]:
    """Return which contacts of a CAV are new collisions, by the memory of the original's collision sensor.

    xy: box centre (n, 2) [m] in every tick. ticks, others: of all contacts, in the order of time. The memory holds the
    last actor, the last time and places. The time is that of the last counted collision, whatever was hit; the actor
    is that of the last one with an actor. So a wall that is hit within 5 s of a vehicle renews the memory of the
    vehicle (protocol 7.2).
    """
    places: list[tuple[float, float]] = []
    last_actor, last_tick, new = "", 0, list[int]()
    # Between two contacts the CAV may leave a place and return, hence every tick and not only those with contacts.
    for tick, (x, y) in enumerate(xy.tolist()):
        if tick - last_tick > SAME_ACTOR_TICKS:
            last_actor = ""
        for i in range(bisect_left(ticks, tick), bisect_right(ticks, tick)):
            is_same = others[i] != "" and others[i] == last_actor
            if not is_same and all(portable.hypot(x - px, y - py) > SAME_PLACE_M for px, py in places):
                new.append(i)
                places.append((x, y))
                last_actor, last_tick = others[i] or last_actor, tick
        places = [(px, py) for px, py in places if portable.hypot(x - px, y - py) <= FORGET_PLACE_M]
    return new


def find_collisions(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return the collisions of a CAV: continued contact, or contact again at the same place, is one collision.

    Ignored are contacts with the last actor that was hit, until more than 5 s have passed since the last counted
    collision of any kind; and contacts within 3 m of an earlier collision, whose place is forgotten once the CAV is
    over 5 m away. The map ("") is never the "last actor", but hitting it counts as a collision of any kind. Places are
    box centres of the CAV.
    """
    contacts = [(tick, contact) for tick, contact in track.episode.contacts if contact.ego == track.ego.id]
    counted: list[InfractionEvent] = []
    for i in find_new_contacts(track.xy, [tick for tick, _ in contacts], [contact.other for _, contact in contacts]):
        tick, contact = contacts[i]
        name, factor = INFRACTION_BY_KIND[contact.kind]
        event = track.make_infraction(name, tick, contact.other, factor)
        counted.append(replace(event, impact_speed=compute_impact_speed(track, tick, contact.other)))
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
