"""Who says that he goes before whom: the memory of all negotiations lies in the messages themselves.

Whoever comes late, or lost a message, reads in the next ones what has been settled.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

from mdrive_sumo.contract import Message
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.v2x.messages import MAX_NAMES, Intention, Mcm, ReferencePose, encode

RightOfWayClaims = frozenset[tuple[str, str]]
"""(first, second) pairs of stations."""


@dataclass(frozen=True, slots=True)
class NegotiationTerms:
    """What an MCM says beyond trajectories; see `v2x.messages.Mcm`."""

    requests: Mapping[str, Intention] = field(default_factory=dict[str, Intention])
    answers: Mapping[str, bool] = field(default_factory=dict[str, bool])
    group: tuple[str, ...] = ()
    until_tick: int = 0


def collect_claims(heard: Mapping[str, Mcm], tick: int) -> RightOfWayClaims:
    """The claims that hold in this tick, by everybody's latest MCM; of two that contradict each other the smaller
    station's counts."""
    said = {
        (name, other)
        for name, mcm in heard.items()
        if mcm.until_tick >= tick
        for other, what in mcm.requests.items()
        if other != name and what <= Intention.SLOWER
    }
    return frozenset((a, b) for a, b in said if a < b or (b, a) not in said)


def answer_claims(me: str, heard: Mapping[str, Mcm], claims: RightOfWayClaims) -> dict[str, bool]:
    """My answers to all who claim to go before me: yes, unless my own claim counts."""
    asking = [
        name for name, mcm in heard.items() if name != me and mcm.requests.get(me, Intention.KEEP) <= Intention.SLOWER
    ]
    return {name: (me, name) not in claims for name in asking[:MAX_NAMES]}


def build_mcm_message(me: NegotiationMember, tick: int, terms: NegotiationTerms) -> Message:
    """My MCM: what I plan and desire, and the terms of the negotiation."""
    pose = ReferencePose(me.x, me.y, me.yaw, tick)
    message = encode(
        Mcm(
            pose=pose,
            speed=me.speed,
            intention=me.intention,
            direction=me.direction,
            interval_s=me.interval_s,
            planned=me.planned,
            desired=me.desired,
            requests=terms.requests,
            answers=terms.answers,
            group=terms.group,
            until_tick=terms.until_tick,
        )
    )
    return Message(message.type, message.payload, me.id, tick)
