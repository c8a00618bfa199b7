"""Who goes first: conflict groups, and negotiators that settle them by rule or by language model."""

from mdrive_sumo.agents.negotiation.llm import LlmNegotiator
from mdrive_sumo.agents.negotiation.options import llm_options
from mdrive_sumo.agents.negotiation.parley import Parley
from mdrive_sumo.agents.negotiation.rule import RuleNegotiator
from mdrive_sumo.agents.negotiation.types import Decision, Member, Negotiator, Step

__all__ = ["Decision", "LlmNegotiator", "Member", "Negotiator", "Parley", "RuleNegotiator", "Step", "llm_options"]
