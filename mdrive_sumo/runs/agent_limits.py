"""Time limits of a user's own agent, as `--agent-limits` writes them: `start=600,tick=30,episode=7200`."""

import math
from collections.abc import Mapping
from dataclasses import replace

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import suggest_name

OPTION = "--agent-limits"
LOCAL_LIMITS = AgentLimits(reply_bytes=2**20, episode_bytes=2**30, option=OPTION)
"""Limits of a user's own agent: as large as the contract allows, since notes alone may have 200 000 characters."""
TIMES = ("start", "tick", "episode")
"""Names of the time limits, each of them a field of AgentLimits with `_s` behind it."""
DEFAULT_TIMES = ",".join(f"{name}={getattr(LOCAL_LIMITS, f'{name}_s'):g}" for name in TIMES)
SHORTEST_S, LONGEST_S = 0.01, 7 * 86_400.0
"""A hundredth of a second is about the time of one answer of an agent that does nothing; a week ends every job."""


def parse_agent_limits(text: str | Mapping[str, float]) -> AgentLimits:
    """Return the limits that the option sets; those that it does not name keep their defaults. Raises InputError.

    text: `start=600,tick=30,episode=7200` in any order, or the same as a mapping [s].
    """
    pairs = _split(text) if isinstance(text, str) else [(name, str(value)) for name, value in text.items()]
    times: dict[str, float] = {}
    for name, value in pairs:
        if name not in TIMES:
            names = ", ".join(TIMES)
            raise InputError(f"{OPTION}: expected one of {names}, found {name!r:.40}{suggest_name(name, TIMES)}")
        if f"{name}_s" in times:
            raise InputError(f"{OPTION}: {name}: expected it once, found it twice")
        times[f"{name}_s"] = _parse_seconds(name, value)
    limits = replace(LOCAL_LIMITS, **times)
    if limits.episode_s < limits.tick_s:
        raise InputError(
            f"{OPTION}: episode: expected at least the {limits.tick_s:g} s of a tick, found {limits.episode_s:g} s;"
            f" add episode=SECONDS, the time for all answers of an episode"
        )
    return limits


def format_agent_limits(limits: AgentLimits) -> str:
    """Return the times that are not the defaults, in the form that `parse_agent_limits` reads; "" if all are."""
    values = {name: (getattr(limits, f"{name}_s"), getattr(LOCAL_LIMITS, f"{name}_s")) for name in TIMES}
    return ",".join(f"{name}={value!r}".removesuffix(".0") for name, (value, usual) in values.items() if value != usual)


def _split(text: str) -> list[tuple[str, str]]:
    pairs = [part.partition("=") for part in text.split(",")]
    if any(not sign for _, sign, _ in pairs):
        raise InputError(f"{OPTION}: expected start=SECONDS,tick=SECONDS,episode=SECONDS, found {text!r:.80}")
    return [(name.strip(), value.strip()) for name, _, value in pairs]


def _parse_seconds(name: str, value: str) -> float:
    try:
        seconds = float(value)
    except ValueError:
        seconds = math.nan
    if not SHORTEST_S <= seconds <= LONGEST_S:
        raise InputError(f"{OPTION}: {name}: expected {SHORTEST_S:g} to {LONGEST_S:.0f} seconds, found {value!r:.40}")
    return seconds
