"""Conditions: the channels of a study, from a base channel and levels of factors."""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from types import MappingProxyType

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.v2x.comm_settings import PRESETS, CommSettings

GRIDS = ("one-at-a-time", "full")
BASE = "base"
"""Name of the condition of the base channel."""
Level = tuple[float, ...]
"""The value of a factor: one number, or for the pose error metres and degrees."""


@dataclass(frozen=True, slots=True)
class ChannelFactor:
    """One property of the channel that a study varies."""

    name: str
    axis: str
    """Label of the axis in plots, with the unit."""
    fields: tuple[str, ...]
    """The fields of `LinkSettings` that a level sets, or of `RadioSettings`."""
    unit: str
    of_radio: bool = False

    def of(self, comm: CommSettings) -> Level | None:
        """Return the level of a channel; None if it differs between types of message, or without a radio."""
        holders = (comm.radio,) if self.of_radio else (comm.link, *comm.by_type.values())
        levels = {tuple(getattr(one, field) for field in self.fields) for one in holders if one is not None}
        return levels.pop() if len(levels) == 1 else None

    def set(self, comm: CommSettings, level: Level) -> CommSettings:
        """Return the channel with a level, for every type of message. Raises InputError without the radio it is of."""
        fields = dict(zip(self.fields, level, strict=True))
        if self.of_radio:
            if comm.radio is None:
                raise InputError(f"study: --{self.name}: expected --comm its-g5 or lte-v2x, found {comm.preset}")
            return replace(comm, radio=replace(comm.radio, **fields))
        links = {name: replace(link, **fields) for name, link in comm.by_type.items()}
        return replace(comm, link=replace(comm.link, **fields), by_type=links)

    def text(self, level: Level) -> str:
        """Return a level as text, e.g. "latency 6 ticks"."""
        numbers = [str(value).removesuffix(".0") for value in level]
        return f"{self.name} " + (f"{numbers[0]} m {numbers[1]}°" if len(level) > 1 else f"{numbers[0]}{self.unit}")


FACTORS: Mapping[str, ChannelFactor] = MappingProxyType(
    {
        factor.name: factor
        for factor in (
            ChannelFactor("latency", "latency [ticks of 0.05 s]", ("latency_ticks",), " ticks"),
            ChannelFactor("loss", "probability of loss", ("loss",), ""),
            ChannelFactor(
                "pose-error", "pose error, standard deviation [m and °]", ("pose_error_m", "pose_error_deg"), ""
            ),
            ChannelFactor(
                "connected-background",
                "connected share of the background",
                ("connected_background",),
                "",
                of_radio=True,
            ),
        )
    }
)


@dataclass(frozen=True, slots=True)
class ChannelCondition:
    """A channel of a study. `levels`: by factor, only where it is not the base channel's."""

    name: str
    comm: CommSettings
    levels: Mapping[str, Level]

    @property
    def folder(self) -> str:
        """The name of the condition's folder."""
        return re.sub(r"[^A-Za-z0-9.+-]+", "_", self.name).strip("_")


def make_conditions(
    base: CommSettings, varied: Mapping[str, Sequence[Level]], grid: str, channels: Sequence[str] = ()
) -> tuple[ChannelCondition, ...]:
    """Return the base condition first, then all others once each. Raises InputError for unusable levels and channels.

    varied: levels by factor. grid: "one-at-a-time" sets one factor at a time and leaves the others at the base
    channel's, "full" makes every combination. channels: presets of `--comm` as they are, further conditions.
    """
    if not base.on:
        raise InputError("study: expected a base channel that is on, found --comm off")
    for name, levels in varied.items():
        if len(set(levels)) != len(levels):
            raise InputError(f"study: --{name}: expected different values, found one twice")
    condition_by_name = {BASE: ChannelCondition(BASE, base, MappingProxyType({}))}
    for levels in _combine_levels(varied, grid):
        condition = _make_condition(base, levels)
        condition_by_name.setdefault(condition.name, condition)
    for name in channels:
        if name not in PRESETS or name in (base.preset, "off"):
            others = ", ".join(one for one in PRESETS if one not in (base.preset, "off"))
            raise InputError(f"study: --channels: expected some of {others}, found {name!r:.40}")
        condition_by_name[name] = ChannelCondition(name, PRESETS[name], MappingProxyType({}))
    return tuple(condition_by_name.values())


def make_off_condition() -> ChannelCondition:
    """Return the reference condition, in which no message is delivered."""
    return ChannelCondition("off", PRESETS["off"], MappingProxyType({}))


def _combine_levels(varied: Mapping[str, Sequence[Level]], grid: str) -> Iterator[dict[str, Level]]:
    if grid == "full":
        for levels in product(*varied.values()):
            yield dict(zip(varied, levels, strict=True))
        return
    for name, levels in varied.items():
        for level in levels:
            yield {name: level}


def _make_condition(base: CommSettings, levels: Mapping[str, Level]) -> ChannelCondition:
    changed = {name: level for name, level in levels.items() if FACTORS[name].of(base) != level}
    comm = base
    for name, level in changed.items():
        comm = FACTORS[name].set(comm, level)
    name = ", ".join(FACTORS[name].text(level) for name, level in changed.items()) or BASE
    return ChannelCondition(name, comm, MappingProxyType(changed))


def parse_levels(name: str, text: str) -> tuple[Level, ...]:
    """Return the levels of a list such as "0,2,6"; latencies are whole numbers. Raises InputError."""
    return tuple((_parse_number(name, part.strip()),) for part in text.split(","))


def parse_pose_levels(metres: str, degrees: str | None) -> tuple[Level, ...]:
    """Return pairs of metres and degrees; without degrees the numbers are equal, as the paper's 0.6 m and 0.6°."""
    rows = [
        parse_levels("pose-error", metres),
        parse_levels("rotation-error", degrees if degrees is not None else metres),
    ]
    if len(rows[0]) != len(rows[1]):
        raise InputError(
            f"study: --rotation-error: expected {len(rows[0])} values, as --pose-error has, found {len(rows[1])}"
        )
    return tuple((x[0], y[0]) for x, y in zip(*rows, strict=True))


def _parse_number(name: str, text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"study: --{name}: expected numbers with commas between them, found {text!r:.40}") from None
    whole, most = name == "latency", {"loss": 1.0, "connected-background": 1.0, "latency": 10_000.0}.get(name, math.inf)
    if not (0 <= value <= most and math.isfinite(value)) or (whole and not value.is_integer()):
        upper = f" and {most:g}" if math.isfinite(most) else ""
        kind = "whole numbers of ticks" if whole else "numbers"
        bounds = f"between 0{upper}" if upper else "of 0 or more"
        raise InputError(f"study: --{name}: expected {kind} {bounds}, found {text!r:.40}")
    return int(value) if whole else value
