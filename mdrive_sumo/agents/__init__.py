"""The built-in agents: one file each, over planning, perception and negotiation; `AGENTS` lists them by name."""

from mdrive_sumo.agents.registry import AGENTS

__all__ = ["AGENTS"]
