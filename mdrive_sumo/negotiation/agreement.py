"""What an agreement means to a member of the group: which others go first, whether it can wait, and when.

An agreement is a request in the MCM of the most central member: its group, the action of each and, if the model states
one, the order in which they pass. Then `Mcm.group` is that order, and the sender accepts its own request in
`Mcm.answers`; by that others know it from a sorted group. Each member answers: yes, or no if it cannot carry it out.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from mdrive_sumo.negotiation.conflict_graph import build_conflict_graph
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember
from mdrive_sumo.negotiation.order_prediction import can_carry_out
from mdrive_sumo.negotiation.rule_negotiator import choose_winner_intention, find_leader_pairs
from mdrive_sumo.negotiation.speaker import GroupAgreement
from mdrive_sumo.planning.planning_order import order_by_urgency
from mdrive_sumo.v2x.messages import Intention, Mcm


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


def release_passed(
    decision: NegotiationDecision, me: str, members: Sequence[NegotiationMember]
) -> NegotiationDecision | None:
    """Return the decision without those that went first and are past; None if nothing is left of it.

    A station is past when it shares no area ahead with the own car any more. One that has gone silent may not be.
    """
    graph = build_conflict_graph(members)
    if not decision.yield_to or me not in graph.ids:
        return decision
    row, entry_time = graph.ids.index(me), graph.entry_time
    heard = decision.yield_to & set(graph.ids)
    past = frozenset(name for name in heard if entry_time[graph.ids.index(name), row] == np.inf)
    if past < decision.yield_to:
        return replace(decision, yield_to=decision.yield_to - past) if past else decision
    intention = choose_winner_intention(next(member for member in members if member.id == me))
    return replace(decision, intention=intention, yield_to=frozenset()) if decision.priority_over else None


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
