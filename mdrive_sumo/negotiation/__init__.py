"""Negotiation of right of way: conflict groups, and negotiators that resolve them by rule or by language model."""

from mdrive_sumo.negotiation.language_model import read_llm_options
from mdrive_sumo.negotiation.llm_negotiator import LlmNegotiator
from mdrive_sumo.negotiation.negotiation_interface import NegotiationInterface
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember, NegotiationStep, Negotiator
from mdrive_sumo.negotiation.rule_negotiator import RuleNegotiator

__all__ = [
    "LlmNegotiator",
    "NegotiationDecision",
    "NegotiationInterface",
    "NegotiationMember",
    "NegotiationStep",
    "Negotiator",
    "RuleNegotiator",
    "read_llm_options",
]
