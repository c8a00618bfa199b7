"""Settings of an attack: its kind, its stations and its parameters, as `--attack` writes them."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum, auto
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown

NO_ATTACK = "none"
"""The attack of honest runs."""
_STATION = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,79}")


class AttackKind(StrEnum):
    """What an attacker does to the messages of its station."""

    PHANTOM = auto()
    """Its CPMs have a car that stands where a receiver has to brake."""
    HIDE = auto()
    """Its CPMs have no objects, and say that the view is free; its features have no tiles."""
    SHIFT = auto()
    """All its messages are shifted, further and further."""
    FORGE_MCM = "forge-mcm"
    """Its MCMs claim priority, or promise to yield; it drives on."""
    REPLAY = auto()
    """It sends its messages of some time ago as new ones."""
    FLOOD = auto()
    """It sends useless bytes in every tick."""


class StationGroup(StrEnum):
    """Stations among which attackers are drawn."""

    CAVS = auto()
    RSUS = auto()
    ALL = auto()


class ForgedClaim(StrEnum):
    """What a forged MCM says."""

    PRIORITY = auto()
    """The sender goes first, and will stand on the receiver's route."""
    YIELD = auto()
    """The sender stops and lets all others go first."""


class Parameter(NamedTuple):
    """A number of one kind of attack."""

    default: float
    low: float
    high: float
    unit: str


PARAMETERS: Mapping[AttackKind, Mapping[str, Parameter]] = MappingProxyType(
    {
        # Chosen: at 0.3 m/s the error stays within the gates of a tracker (99 % of correct pairs) for some seconds, so
        # that tracks follow it; 8 m is more than two lanes.
        AttackKind.SHIFT: {"rate": Parameter(0.3, 0.01, 50.0, "m/s"), "most": Parameter(8.0, 0.1, 300.0, "m")},
        # Chosen: in 3 s a car of the benchmark (8 m/s) leaves a junction.
        AttackKind.REPLAY: {"delay": Parameter(3.0, 0.1, 60.0, "s")},
        # Half of the 6 Mbit/s of a 10 MHz channel (docs/v2x.md): more than the 68 % that congestion control aims at
        # with the airtime of preambles and gaps, without headers of its own.
        AttackKind.FLOOD: {"bytes": Parameter(375_000.0, 1.0, 1_000_000.0, "bytes/s")},
    }
)
"""The parameters of each kind; kinds that are not listed have none."""
_COMMON = ("by", "share", "among")


@dataclass(frozen=True, slots=True)
class AttackSettings:
    """An attack, checked by `parse_attack`."""

    kind: AttackKind
    by: tuple[str, ...] = ()
    """Ids of the attackers; (): they are drawn."""
    share: int | None = None
    """Percentage of the stations of `among` that attack, rounded, at least one; None: exactly one."""
    among: StationGroup = StationGroup.CAVS
    """The stations among which attackers are drawn."""
    claim: ForgedClaim = ForgedClaim.PRIORITY
    """What forged MCMs say."""
    values: Mapping[str, float] = field(default_factory=dict[str, float])
    """The parameters of the kind by name, as in `PARAMETERS`."""

    @property
    def text(self) -> str:
        """The attack as `--attack` writes it, without what is as by default."""
        parts: dict[str, str] = {}
        if self.by:
            parts["by"] = "+".join(self.by)
        if self.share is not None:
            parts["share"] = str(self.share)
        if self.among is not StationGroup.CAVS:
            parts["among"] = str(self.among)
        if self.claim is not ForgedClaim.PRIORITY:
            parts["claim"] = str(self.claim)
        for name, parameter in PARAMETERS.get(self.kind, {}).items():
            if self.values[name] != parameter.default:
                parts[name] = str(self.values[name]).removesuffix(".0")
        options = ",".join(f"{name}={value}" for name, value in parts.items())
        return f"{self.kind}:{options}" if options else str(self.kind)


@lru_cache(maxsize=64)
def parse_attack(text: str) -> AttackSettings | None:
    """Return the attack of "KIND" or "KIND:NAME=VALUE,..."; None for "none". Raises InputError.

    by=ID+ID: the attackers; share=PERCENT and among=cavs|rsus|all: how many are drawn, and among which stations;
    claim=priority|yield: of forged MCMs; rate, most, delay, bytes: see `PARAMETERS`.
    """
    if text == NO_ATTACK:
        return None
    name, colon, rest = text.partition(":")
    kinds = [str(kind) for kind in AttackKind]
    if name not in kinds:
        raise InputError(f"attack: {describe_unknown(name, (NO_ATTACK, *kinds))}")
    kind = AttackKind(name)
    given = _split_options(kind, rest) if colon else {}
    by = _parse_stations(given["by"]) if "by" in given else ()
    if by and ("share" in given or "among" in given):
        raise InputError(f"attack {kind}: expected by=... or share=... and among=..., found both")
    return AttackSettings(
        kind,
        by,
        _parse_share(given["share"]) if "share" in given else None,
        StationGroup(_parse_choice(kind, given, "among", [str(one) for one in StationGroup], StationGroup.CAVS)),
        ForgedClaim(_parse_choice(kind, given, "claim", [str(one) for one in ForgedClaim], ForgedClaim.PRIORITY)),
        MappingProxyType(
            {
                option: _parse_number(kind, option, given[option], parameter) if option in given else parameter.default
                for option, parameter in PARAMETERS.get(kind, {}).items()
            }
        ),
    )


def _split_options(kind: AttackKind, text: str) -> dict[str, str]:
    """Return the options after the colon by name. Raises InputError."""
    own = ("claim",) if kind is AttackKind.FORGE_MCM else tuple(PARAMETERS.get(kind, {}))
    options: dict[str, str] = {}
    for part in text.split(","):
        name, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals or name not in (*_COMMON, *own):
            raise InputError(f"attack {kind}: expected options among {', '.join((*_COMMON, *own))}, found {part!r:.60}")
        if name in options:
            raise InputError(f"attack {kind}: expected {name} once, found it twice")
        options[name] = value
    return options


def _parse_stations(text: str) -> tuple[str, ...]:
    stations = tuple(text.split("+"))
    if len(set(stations)) < len(stations) or not all(_STATION.fullmatch(station) for station in stations):
        raise InputError(f"attack: by: expected different ids of stations with + between them, found {text!r:.80}")
    return tuple(sorted(stations))


def _parse_share(text: str) -> int:
    if not (text.isascii() and text.isdecimal() and 1 <= int(text) <= 100):
        raise InputError(f"attack: share: expected a whole percentage from 1 to 100, found {text!r:.40}")
    return int(text)


def _parse_choice(kind: AttackKind, given: Mapping[str, str], name: str, choices: list[str], default: str) -> str:
    value = given.get(name, default)
    if value not in choices:
        raise InputError(f"attack {kind}: {name}: {describe_unknown(value, choices)}")
    return value


def _parse_number(kind: AttackKind, name: str, text: str, parameter: Parameter) -> float:
    try:
        value = float(text)
    except ValueError:
        value = float("nan")
    if not parameter.low <= value <= parameter.high:  # nor is NaN
        limits = f"{parameter.low:g} to {parameter.high:g} {parameter.unit}"
        raise InputError(f"attack {kind}: {name}: expected a number from {limits}, found {text!r:.40}")
    return value
