"""Settings of a V2X channel, and the presets of `--comm`."""

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import Any

from mdrive_sumo.contract import NAME
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.v2x.messages import TYPES
from mdrive_sumo.v2x.radio.radio_settings import CornerModel, RadioProfile, RadioSettings

PER = ("message", "episode")
_MUTE = re.compile(r"(\*|[A-Za-z0-9][A-Za-z0-9_.+-]{0,79})/(\*|" + NAME.pattern + r")(?:@(\*|[0-9]{1,9}))?")


def _check(fine: bool, of: object, name: str, expected: str) -> None:
    if not fine:
        raise InputError(f"V2X channel: {name}: expected {expected}, found {getattr(of, name)!r:.40}")


@dataclass(frozen=True, slots=True)
class LinkSettings:
    """Transmission of the messages of one type to one receiver. Raises InputError for invalid values."""

    latency_ticks: int = 0
    """A message sent in tick t is in the observation of tick t + max(latency, 1): never in the tick of its sending."""
    loss: float = 0.0
    """Probability in [0, 1], drawn for every receiver."""
    range_m: float = math.inf
    """Maximum distance [m] between sender and receiver at the time of sending."""
    pose_error_m: float = 0.0
    """Standard deviation [m] of the errors of x and y of the sender's pose at the receiver."""
    pose_error_deg: float = 0.0
    pose_error_per: str = "message"
    """"message": drawn for every message and receiver; "episode": once for every pair of stations."""

    def __post_init__(self) -> None:
        _check(type(self.latency_ticks) is int and 0 <= self.latency_ticks <= 10_000, self, "latency_ticks",
               "a whole number of ticks from 0 to 10000")  # fmt: skip
        _check(0 <= self.loss <= 1, self, "loss", "a probability in [0, 1]")
        _check(self.range_m > 0, self, "range_m", "a distance above 0 m")
        for name in ("pose_error_m", "pose_error_deg"):
            _check(0 <= getattr(self, name) < math.inf, self, name, "a finite standard deviation of 0 or more")
        _check(self.pose_error_per in PER, self, "pose_error_per", f"one of {', '.join(PER)}")


@dataclass(frozen=True, slots=True)
class MuteFilter:
    """Filter of muted messages; any part of (sender, type, tick) may be "*"."""

    patterns: frozenset[tuple[str, str, str]]

    def __bool__(self) -> bool:
        return bool(self.patterns)

    def matches(self, sender: str, message_type: str, tick: int) -> bool:
        """Return whether that message is muted."""
        tick_text = str(tick)
        return any(
            (by_sender, by_type, by_tick) in self.patterns
            for by_sender in (sender, "*")
            for by_type in (message_type, "*")
            for by_tick in (tick_text, "*")
        )


@dataclass(frozen=True, slots=True)
class CommSettings:
    """A channel: default link settings, settings by message type, a byte budget, and muted messages.

    Raises InputError for invalid values.
    """

    preset: str = "ideal"
    """Origin of these settings; only the values below have an effect."""
    on: bool = True
    """False: nothing is ever delivered."""
    link: LinkSettings = LinkSettings()
    by_type: Mapping[str, LinkSettings] = field(default_factory=dict[str, LinkSettings])
    """Links of single types in `messages.TYPES`; an agent's own types have the link of all."""
    budget_bytes_s: float = math.inf
    """Maximum bytes per station in any second, headers included; further messages are dropped."""
    header_bytes: int = 0
    """Added to every payload when its size is counted: network, transport and security headers."""
    mute: tuple[str, ...] = ()
    """Messages that are never delivered, for ablations: "SENDER/TYPE" or "SENDER/TYPE@TICK", each part may be "*"."""
    radio: RadioSettings | None = None
    """The radio that messages take before what `link` does to them; None: none, all are heard."""

    def __post_init__(self) -> None:
        _check(type(self.on) is bool, self, "on", "true or false")
        _check(self.budget_bytes_s > 0, self, "budget_bytes_s", "a number of bytes above 0")
        _check(type(self.header_bytes) is int and 0 <= self.header_bytes <= 65535, self, "header_bytes",
               "a whole number from 0 to 65535")  # fmt: skip
        for name in self.by_type:
            if name not in TYPES:
                raise InputError(
                    f"V2X channel: unknown type of message {name!r:.40}, expected one of {', '.join(TYPES)}"
                )
        for pattern in self.mute:
            if not _MUTE.fullmatch(pattern):
                raise InputError(
                    f"V2X channel: mute: expected SENDER/TYPE or SENDER/TYPE@TICK, each may be *, found {pattern!r:.80}"
                )

    def find_link(self, message_type: str) -> LinkSettings:
        """Return the link settings of a message type."""
        return self.by_type.get(message_type, self.link)

    @property
    def mute_filter(self) -> MuteFilter:
        """The filter that `mute` describes."""
        matches = (_MUTE.fullmatch(pattern) for pattern in self.mute)
        return MuteFilter(
            frozenset((m[1], m[2], str(int(t)) if (t := m[3] or "*") != "*" else t) for m in matches if m)
        )


PRESETS: Mapping[str, CommSettings] = MappingProxyType(
    {
        "ideal": CommSettings(),
        "off": CommSettings("off", on=False),
        "paper-latency": CommSettings("paper-latency", link=LinkSettings(latency_ticks=6)),
        "paper-pose": CommSettings("paper-pose", link=LinkSettings(pose_error_m=0.6, pose_error_deg=0.6)),
        # ITS-G5 that meets what 3GPP TR 22.885, annex A, asks for in towns without line of sight (100 ms, 90 % at
        # 150 m), in the 3 % of air time that TS 102 687 grants at 6 Mbit/s. Headers: MAC and LLC 38 B, GeoNetworking
        # single-hop 40 B, BTP 4 B, signature and digest 95 B, and 30 B for the air time of the preamble.
        # docs/v2x.md has every source, and says what this is not.
        # No pose error: messages carry what their sender estimates, whose errors the sensing profile brings.
        "realistic": CommSettings(
            "realistic",
            link=LinkSettings(latency_ticks=2, loss=0.1, range_m=150.0),
            budget_bytes_s=22_500.0,
            header_bytes=207,
        ),
        # Radios that lose what distance, walls, vehicles and load make them lose: docs/radio.md.
        "its-g5": CommSettings("its-g5", radio=RadioSettings(RadioProfile.ITS_G5)),
        "lte-v2x": CommSettings("lte-v2x", radio=RadioSettings(RadioProfile.LTE_V2X)),
    }
)

_LINK: Mapping[str, type] = {f.name: type(f.default) for f in fields(LinkSettings)}
_RADIO_CHOICES: Mapping[str, type[RadioProfile] | type[CornerModel]] = {
    "profile": RadioProfile,
    "corner_model": CornerModel,
}
_RADIO_NUMBERS = ("power_dbm", "antenna_gain_dbi", "connected_background")
_RADIO_PREFIX = "radio."
_OWN: Mapping[str, type] = {"preset": str, "on": bool, "budget_bytes_s": float, "header_bytes": int, "mute": str}


def format_comm_json(comm: CommSettings) -> str:
    """Return the channel as canonical JSON of `describe_comm`."""
    return json.dumps(describe_comm(comm), sort_keys=True, separators=(",", ":"))


def describe_comm(comm: CommSettings) -> dict[str, str | float | bool]:
    """Return the channel as scalars, for results: without unlimited values; links of a type are "TYPE.field"."""
    own = {name: kind(getattr(comm, name)) for name, kind in _OWN.items() if name != "mute"}
    scalars = own | _describe_link("", comm.link)
    for name in sorted(comm.by_type):
        scalars |= _describe_link(f"{name}.", comm.by_type[name])
    if comm.radio is not None:
        scalars |= {_RADIO_PREFIX + name: str(getattr(comm.radio, name)) for name in _RADIO_CHOICES}
        scalars |= {_RADIO_PREFIX + name: float(getattr(comm.radio, name)) for name in _RADIO_NUMBERS}
    if comm.mute:
        scalars["mute"] = " ".join(comm.mute)
    return {name: value for name, value in scalars.items() if value != math.inf}


def _describe_link(prefix: str, link: LinkSettings) -> dict[str, str | float | bool]:
    return {prefix + name: kind(getattr(link, name)) for name, kind in _LINK.items()}


def parse_comm(values: Mapping[str, Any]) -> CommSettings:
    """Return the settings for the output of `describe_comm`. Raises InputError that names option, expected and found.

    Missing options have the value of the ideal channel.
    """
    own: dict[str, Any] = {}
    links: dict[str, dict[str, Any]] = {"": {}}
    radio: dict[str, Any] = {}
    for name, value in values.items():
        if name.startswith(_RADIO_PREFIX):
            radio |= _parse_radio_option(name, value)
            continue
        of_type, dot, option = name.rpartition(".")
        kind = _LINK.get(option) or (None if dot else _OWN.get(option))
        if kind is None or (dot and not of_type):
            raise InputError(f"V2X channel: unknown option {name!r:.60}, expected one of {', '.join((*_OWN, *_LINK))}")
        (links.setdefault(of_type, {}) if option in _LINK else own)[option] = _convert_value(name, value, kind)
    if own.get("preset", "ideal") not in PRESETS:
        raise InputError(f"V2X channel: unknown preset {own['preset']!r:.40}, expected one of {', '.join(PRESETS)}")
    if radio:
        if "profile" not in radio:
            raise InputError(f"V2X channel: radio.profile: expected one of {', '.join(RadioProfile)}, found none")
        own["radio"] = RadioSettings(**radio)
    own["mute"] = tuple(own.get("mute", "").split())
    by_type = {name: LinkSettings(**options) for name, options in links.items() if name}
    return CommSettings(**own, link=LinkSettings(**links[""]), by_type=by_type)


def _parse_radio_option(name: str, value: object) -> dict[str, Any]:
    option = name.removeprefix(_RADIO_PREFIX)
    if option in _RADIO_NUMBERS:
        return {option: _convert_value(name, value, float)}
    choices = _RADIO_CHOICES.get(option)
    if choices is None:
        known = ", ".join((*_RADIO_CHOICES, *_RADIO_NUMBERS))
        raise InputError(f"V2X channel: unknown option {name!r:.60}, expected one of {known} of a radio")
    values = tuple(str(choice) for choice in choices)
    if value not in values:
        raise InputError(f"V2X channel: {name}: expected one of {', '.join(values)}, found {value!r:.40}")
    return {option: choices(value)}


def _convert_value(name: str, value: object, kind: type) -> Any:
    """Return the value as that type; JSON and pydantic do not distinguish 6 from 6.0."""
    if kind in (str, bool) and type(value) is kind:
        return value
    if kind in (int, float) and type(value) in (int, float):
        number = float(value)  # pyright: ignore[reportArgumentType] - it is a number
        if math.isfinite(number) and (kind is float or number.is_integer()):
            return kind(number)
    words = {str: "a text", bool: "true or false", int: "a whole number", float: "a finite number"}
    raise InputError(f"V2X channel: {name}: expected {words[kind]}, found {value!r:.40}")
