"""Who goes first: conflict groups, and negotiators that settle them by rule or by language model."""

from mdrive_sumo.negotiation.llm_negotiator import LlmNegotiator
from mdrive_sumo.negotiation.llm_options import llm_options
from mdrive_sumo.negotiation.negotiation_interface import Parley
from mdrive_sumo.negotiation.rule_negotiator import RuleNegotiator
from mdrive_sumo.negotiation.types import Decision, Member, Negotiator, Step

__all__ = ["Decision", "LlmNegotiator", "Member", "Negotiator", "Parley", "RuleNegotiator", "Step", "llm_options"]
