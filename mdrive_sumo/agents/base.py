"""What the built-in agents share: how an agent is made, and its checked options."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from mdrive_sumo.contract import Agent
from mdrive_sumo.errors import InputError

Config: TypeAlias = Mapping[str, float | str | bool]
AgentFactory: TypeAlias = Callable[[Config], Agent]


@dataclass(frozen=True, slots=True)
class Option:
    """A number that a user may set: its default and the range that makes sense, ends included."""

    default: float
    low: float
    high: float


def read_options(agent: str, config: Config, options: Mapping[str, Option]) -> dict[str, float]:
    """Every option's value; raises InputError for an unknown name or a value that is no number in its range."""
    unknown = sorted(set(config) - set(options))
    if unknown:
        known = ", ".join(sorted(options)) or "none"
        raise InputError(f"agent {agent}: expected options among ({known}), found {unknown[0]!r}")
    return {name: _number(agent, name, config, option) for name, option in options.items()}


def _number(agent: str, name: str, config: Config, option: Option) -> float:
    value = config.get(name, option.default)
    wanted = f"agent {agent}: option {name}: expected a number in [{option.low:g}, {option.high:g}]"
    if isinstance(value, bool):
        raise InputError(f"{wanted}, found {value}")
    try:
        number = float(value)
    except ValueError:
        raise InputError(f"{wanted}, found {value!r}") from None
    if not (math.isfinite(number) and option.low <= number <= option.high):
        raise InputError(f"{wanted}, found {number:g}")
    return number
