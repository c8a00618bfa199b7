"""The note about the outcome of a round."""

import json

from mdrive_sumo.negotiation.conversation import Conversation
from mdrive_sumo.negotiation.critic import Critique
from mdrive_sumo.negotiation.speaker import GroupAgreement

OUTCOME = "negotiation"
"""Kind of the note about the outcome of a round."""


def format_outcome(
    conversation: Conversation,
    agreement: GroupAgreement,
    critique: Critique,
    decided_by: str,
) -> str:
    """Return the outcome of a round as JSON; the total is the original's, with a missing consensus counted as 0."""
    consensus = agreement.consensus
    outcome = {
        "group": conversation.group,
        "round": conversation.round,
        "by": decided_by,
        "actions": {name: action.name for name, action in agreement.actions.items()},
        "safety": round(critique.safety, 3),
        "efficiency": round(critique.efficiency, 3),
        "consensus": consensus,
        "total": round(3 * (consensus or 0.0) + 5 * critique.safety + 2 * critique.efficiency, 3),
        "feedback": critique.feedback,
    }
    if agreement.order:
        outcome["order"] = agreement.order
    return json.dumps(outcome, sort_keys=True, separators=(",", ":"))
