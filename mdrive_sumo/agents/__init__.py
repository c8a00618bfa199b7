"""Agents: the built-in ones by name, and what runs everybody else's in a process of its own.

`AGENTS` is imported when it is asked for: the process of a third-party agent imports `agents.host` and little else.
"""

from typing import TYPE_CHECKING, Any

from mdrive_sumo.agents.base import AgentFactory, Config

if TYPE_CHECKING:
    from mdrive_sumo.agents.builtin import AGENTS

__all__ = ["AGENTS", "AgentFactory", "Config"]


def __getattr__(name: str) -> Any:
    if name != "AGENTS":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from mdrive_sumo.agents.builtin import AGENTS

    return AGENTS
