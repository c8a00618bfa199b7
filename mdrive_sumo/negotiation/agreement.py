"""The result of one round of a negotiation by language model: decision and outcome note."""

import json
from collections.abc import Mapping, Sequence

from mdrive_sumo.negotiation.conflict_graph import STEP_TICKS, ConflictGraph, build_conflict_graph
from mdrive_sumo.negotiation.conversation import Conversation
from mdrive_sumo.negotiation.critic import Critique
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember
from mdrive_sumo.v2x.messages import Intention


def count_conflict_ticks(graph: ConflictGraph, group: Sequence[str]) -> int:
    """Return the ticks until the last conflict of a group, one planning step if there is none."""
    return graph.count_conflict_ticks(group) if graph.in_conflict.any() else STEP_TICKS


def build_decision(
    me: str,
    members: Sequence[NegotiationMember],
    actions: Mapping[str, Intention],
    group: tuple[str, ...],
    until: int,
) -> NegotiationDecision:
    """Return the own decision from the actions of all: the member with the faster action goes first."""
    mine = actions[me]
    graph = build_conflict_graph(members)
    opponents = (graph.find_opponents(me) if me in graph.ids else frozenset()) & set(group)
    action_by_id = {name: actions.get(name, Intention.KEEP) for name in opponents}
    first = frozenset(name for name, action in action_by_id.items() if action > mine)
    after = frozenset(name for name, action in action_by_id.items() if action < mine)
    return NegotiationDecision(mine, first, after, until, tuple(group))


def format_outcome(
    conversation: Conversation,
    actions: Mapping[str, Intention],
    critique: Critique,
    consensus: float | None,
    decided_by: str,
) -> str:
    """Return the outcome of a round as JSON; the total is the original's, with a missing consensus counted as 0."""
    outcome = {
        "group": conversation.group,
        "round": conversation.round,
        "by": decided_by,
        "actions": {name: action.name for name, action in actions.items()},
        "safety": round(critique.safety, 3),
        "efficiency": round(critique.efficiency, 3),
        "consensus": consensus,
        "total": round(3 * (consensus or 0.0) + 5 * critique.safety + 2 * critique.efficiency, 3),
        "feedback": critique.feedback,
    }
    return json.dumps(outcome, sort_keys=True, separators=(",", ":"))
