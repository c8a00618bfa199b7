"""Options of built-in agents: type aliases, and validation of a configuration."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import TypeAlias

from mdrive_sumo.contract import Agent
from mdrive_sumo.core.errors import InputError

Config: TypeAlias = Mapping[str, float | str | bool]
AgentFactory: TypeAlias = Callable[[Config], Agent]


@dataclass(frozen=True, slots=True)
class Option:
    """A numeric option: its default and its closed range."""

    default: float
    low: float
    high: float
    is_switch: bool = False
    """Only `low` and `high` are valid, and False and True for them."""


@dataclass(frozen=True, slots=True)
class Choice:
    """A text option: its default and all valid values."""

    default: str
    among: tuple[str, ...]


NO_CHOICES: Mapping[str, Choice] = MappingProxyType({})


def read_options(
    agent: str, config: Config, options: Mapping[str, Option], choices: Mapping[str, Choice] = NO_CHOICES
) -> dict[str, float]:
    """Return the value of every numeric option. Raises InputError for an unknown name or a value out of range."""
    unknown = sorted(set(config) - set(options) - set(choices))
    if unknown:
        known = ", ".join(sorted((*options, *choices))) or "none"
        raise InputError(f"agent {agent}: expected options among ({known}), found {unknown[0]!r}")
    return {name: _number(agent, name, config, option) for name, option in options.items()}


def read_choice(agent: str, config: Config, name: str, choice: Choice) -> str:
    """Return the chosen value. Raises InputError if it is not one of `choice.among`."""
    value = config.get(name, choice.default)
    if value not in choice.among:
        raise InputError(f"agent {agent}: option {name}: expected one of {', '.join(choice.among)}, found {value!r}")
    return str(value)


def _number(agent: str, name: str, config: Config, option: Option) -> float:
    value = config.get(name, option.default)
    values = (
        f"{option.low:g} or {option.high:g}" if option.is_switch else f"a number in [{option.low:g}, {option.high:g}]"
    )
    wanted = f"agent {agent}: option {name}: expected {values}"
    if isinstance(value, bool) and not option.is_switch:
        raise InputError(f"{wanted}, found {value}")
    try:
        number = float(value)
    except ValueError:
        raise InputError(f"{wanted}, found {value!r}") from None
    is_valid = number in (option.low, option.high) if option.is_switch else option.low <= number <= option.high
    if not is_valid:  # nor is NaN
        raise InputError(f"{wanted}, found {number:g}")
    return number
