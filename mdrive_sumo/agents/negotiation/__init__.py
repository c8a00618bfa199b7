"""Who goes first: conflict groups, and negotiators that settle them by rule or by language model."""

from mdrive_sumo.agents.negotiation.intention import direction_of, intention_of
from mdrive_sumo.agents.negotiation.rule import RuleNegotiator
from mdrive_sumo.agents.negotiation.types import Decision, Member, Negotiator, Step

__all__ = ["Decision", "Member", "Negotiator", "RuleNegotiator", "Step", "direction_of", "intention_of"]
