"""Claims to go first. All results of negotiations are contained in the MCMs themselves.

A CAV that joins late or lost a message reads in the next ones what has been settled.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mdrive_sumo.contract import Message
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.v2x.messages import MAX_NAMES, MESSAGE_REACH_M, Intention, Mcm, ReferencePose, encode

RightOfWayClaims = frozenset[tuple[str, str]]
"""(first, second) pairs of stations: the first claims to go before the second."""

MCM_REACH_M = MESSAGE_REACH_M - 1.0
"""Points of trajectories are announced as far as a message can carry them."""


@dataclass(frozen=True, slots=True)
class NegotiationTerms:
    """The negotiation part of an MCM; see `v2x.messages.Mcm`."""

    requests: Mapping[str, Intention] = field(default_factory=dict[str, Intention])
    answers: Mapping[str, bool] = field(default_factory=dict[str, bool])
    group: tuple[str, ...] = ()
    until_tick: int = 0


def collect_claims(mcm_by_station: Mapping[str, Mcm], tick: int) -> RightOfWayClaims:
    """Return the claims in force at that tick; of two contradicting ones that of the smaller station id counts."""
    claims = {
        (name, other)
        for name, mcm in mcm_by_station.items()
        if mcm.until_tick >= tick
        for other, intention in mcm.requests.items()
        if other != name and intention <= Intention.SLOWER
    }
    return frozenset((a, b) for a, b in claims if a < b or (b, a) not in claims)


def answer_claims(own_id: str, mcm_by_station: Mapping[str, Mcm], claims: RightOfWayClaims) -> dict[str, bool]:
    """Return the answers to all stations that claim to go first: yes, unless the own claim counts."""
    claimants = [
        name
        for name, mcm in mcm_by_station.items()
        if name != own_id and mcm.requests.get(own_id, Intention.KEEP) <= Intention.SLOWER
    ]
    return {name: (own_id, name) not in claims for name in claimants[:MAX_NAMES]}


def build_mcm_message(member: NegotiationMember, tick: int, terms: NegotiationTerms) -> Message:
    """Return the MCM of a member: its planned and desired trajectories and the terms of the negotiation."""
    message = encode(
        Mcm(
            pose=ReferencePose(member.x, member.y, member.yaw, tick, member.position_sigma, member.yaw_sigma),
            speed=member.speed,
            intention=member.intention,
            direction=member.direction,
            interval_s=member.interval_s,
            planned=_crop_to_reach(member, member.planned),
            desired=_crop_to_reach(member, member.desired),
            requests=terms.requests,
            answers=terms.answers,
            group=terms.group,
            until_tick=terms.until_tick,
        )
    )
    return Message(message.type, message.payload, member.id, tick)


def _crop_to_reach(member: NegotiationMember, points: Float) -> Float:
    """Return the points (N, 2) [m] before the first that a message cannot carry: at 33 m/s a plan is too long."""
    distance = portable.hypot(points[:, 0] - member.x, points[:, 1] - member.y)
    beyond = np.flatnonzero(distance > MCM_REACH_M)
    return points if not len(beyond) else points[: beyond[0]]
