"""What an agreement means to a member of the group: which others go first, whether it can wait, and when.

An agreement is a request in the MCM of the most central member: its group, the action of each and, if the model states
one, the order in which they pass. Then `Mcm.group` is that order, and the sender accepts its own request in
`Mcm.answers`; by that others know it from a sorted group. Each member answers: yes, or no if it cannot carry it out.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.negotiation.conflict_graph import CONFLICT, build_conflict_graph
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember
from mdrive_sumo.negotiation.order_prediction import can_carry_out
from mdrive_sumo.negotiation.rule_negotiator import choose_winner_intention, find_leader_pairs
from mdrive_sumo.negotiation.speaker import GroupAgreement
from mdrive_sumo.planning.planning_order import order_by_urgency
from mdrive_sumo.v2x.messages import Intention, Mcm


@dataclass(frozen=True, slots=True)
class Request:
    """What a member was asked to do, so far as an answer depends on it."""

    action: Intention
    order: tuple[str, ...]
    until_tick: int


@dataclass(frozen=True, slots=True)
class OwnAgreement:
    """What the own car, as the most central member, has asked all others to do."""

    agreement: GroupAgreement
    tick: int
    until_tick: int
    is_revised: bool = False
    """Whether a member has refused it, and it was changed."""


def read_agreement(source: str, mcm: Mcm) -> GroupAgreement:
    """Return the agreement in the MCM of a station; only one that the station itself accepts has an order."""
    has_order = mcm.answers.get(source) is True and set(mcm.group) <= set(mcm.requests)
    return GroupAgreement(mcm.requests, mcm.group if has_order else ())


def is_possible(me: str, members: Sequence[NegotiationMember], agreement: GroupAgreement) -> bool:
    """Return whether the own car can do its part; what has no order is never refused, as in the original."""
    present = {member.id for member in members}
    order = [name for name in agreement.order if name in present]
    return me not in order or can_carry_out(me, members, agreement.actions, order)


def build_decision(
    me: str,
    members: Sequence[NegotiationMember],
    agreement: GroupAgreement,
    group: tuple[str, ...],
    until: int,
) -> NegotiationDecision:
    """Return the own decision: opponents before the own car in the order go first, or without an order the faster."""
    mine, order = agreement.actions[me], agreement.order
    graph = build_conflict_graph(members)
    opponents = (graph.find_opponents(me) if me in graph.ids else frozenset()) & set(group)
    if order:
        first = opponents & set(order[: order.index(me)])
        return NegotiationDecision(mine, first, opponents - first, until, order)
    action_by_id = {name: agreement.actions.get(name, Intention.KEEP) for name in opponents}
    first = frozenset(name for name, action in action_by_id.items() if action > mine)
    after = frozenset(name for name, action in action_by_id.items() if action < mine)
    return NegotiationDecision(mine, first, after, until, tuple(group))


def find_exits(me: str, members: Sequence[NegotiationMember], names: Collection[str]) -> dict[str, Float]:
    """Return where each of these stations leaves the area that it shares with the own car: a point (2,) [m].

    A station that shares none within the prediction has left it.
    """
    by_id = {member.id: member for member in members}
    exits: dict[str, Float] = {}
    for name in sorted(set(names) & set(by_id)) if me in by_id else ():
        points, mine = by_id[name].desired, by_id[me].desired
        gaps = portable.hypot(points[:, None, 0] - mine[None, :, 0], points[:, None, 1] - mine[None, :, 1])
        inside = np.flatnonzero(gaps.min(axis=1) < CONFLICT.min_distance_m)
        exits[name] = points[inside[-1]] if len(inside) else np.array((by_id[name].x, by_id[name].y))
    return exits


def release_passed(
    decision: NegotiationDecision, me: str, members: Sequence[NegotiationMember], exits: Mapping[str, Float]
) -> NegotiationDecision | None:
    """Return the decision without those that went first and are past their exit; None if nothing is left of it.

    A car that brakes shares nothing within the prediction either, so that does not tell. One that has gone silent may
    still be on its way.
    """
    by_id = {member.id: member for member in members}
    past = frozenset(name for name in decision.yield_to if name in by_id and _is_past(by_id[name], exits.get(name)))
    if not past or me not in by_id:
        return decision
    if past < decision.yield_to:
        return replace(decision, yield_to=decision.yield_to - past)
    intention = choose_winner_intention(by_id[me])
    return replace(decision, intention=intention, yield_to=frozenset()) if decision.priority_over else None


def _is_past(member: NegotiationMember, leaves_at: Float | None) -> bool:
    if leaves_at is None:
        return False
    cos, sin = portable.cos_sin(member.yaw)
    return float(cos * (leaves_at[0] - member.x) + sin * (leaves_at[1] - member.y)) < 0.0


def move_forward(
    refusing: Collection[str], agreement: GroupAgreement, members: Sequence[NegotiationMember]
) -> GroupAgreement:
    """Return the agreement with the members that refused it as far in front as those allow that they follow."""
    order = agreement.order
    urgency = {name: float(i - len(order) * (name in refusing)) for i, name in enumerate(order)}
    changed = order_by_urgency(order, urgency, find_leader_pairs(members))
    by_id = {member.id: member for member in members}
    actions = dict(agreement.actions)
    for name in order:
        if name in refusing:
            actions[name] = choose_winner_intention(by_id[name])
        elif changed.index(name) > order.index(name):
            actions[name] = min(actions[name], Intention.SLOWER)
    return replace(agreement, order=changed, actions=actions)
