"""Options of settings: they are made from the fields of `RunConfig` and of the settings classes in it."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, TypeVar

import click
from click.core import ParameterSource

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.cli.options import FiniteRange, make_scenario_option, workers_option
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.setting import Setting, list_settings
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.runs.agent_spec import parse_agent_limits
from mdrive_sumo.runs.run_config import MAX_SEED, MAX_SEEDS, RunConfig
from mdrive_sumo.v2x.comm_settings import PER, PRESETS, CommSettings
from mdrive_sumo.v2x.messages import TYPES
from mdrive_sumo.v2x.radio.radio_settings import CornerModel, RadioProfile, RadioSettings

Command = TypeVar("Command", bound=Callable[..., Any])
Option = Callable[[Any], Any]
"""A decorator that adds an option to a command."""
_SETTINGS: Mapping[str, Setting] = {one.key: one for one in list_settings(RunConfig)}
_EACH = "for all types of message, or for some: "
_CHANNEL_OPTIONS: Mapping[str, Mapping[str, Any]] = {
    "comm_latency": {"metavar": "TICKS", "help": f"Delay, {_EACH}6,text=20 or cpm=2."},
    "comm_loss": {"metavar": "P", "help": f"Probability of loss, {_EACH}0.1,cam=0."},
    "comm_range": {"metavar": "M", "help": f"Reach in metres or inf, {_EACH}200,cpm=70."},
    "comm_budget": {"metavar": "BYTES_PER_S", "help": "Bytes that a station may send per second, or inf."},
    "pose_error": {
        "metavar": "POS_M,ROT_DEG[,episode]",
        "help": f"Standard deviations of senders' poses, drawn per message or episode, {_EACH}0.6,0.6,cam=0,0.",
    },
    "comm_mute": {
        "multiple": True,
        "metavar": "SENDER/TYPE[@TICK]",
        "help": "Drop these messages; * is any. SENDER: an id of the scenarios.",
    },
    "comm_power": {"metavar": "DBM", "help": "Radios: transmit power."},
    "comm_gain": {"metavar": "DBI", "help": "Radios: gain of every antenna."},
    "comm_corner": {"metavar": "|".join(CornerModel), "help": "Radios: path loss round the corner of a house."},
    "connected_background": {"metavar": "P", "help": "Radios: share of background vehicles that send CAMs."},
}
"""Changes of the channel that `--comm` names: arguments of `click.option` by the name of the option."""


def add_options(options: Sequence[Option]) -> Callable[[Command], Command]:
    """Return a decorator that adds options to a click command, the first of them on top of its help."""

    def decorate(command: Command) -> Command:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def setting_option(key: str, **changes: Any) -> Option:
    """Return the option of one setting. changes: arguments of `click.option` in which a command differs from `eval`."""
    one = _SETTINGS[key]
    if key == "scenario":
        return make_scenario_option(changes.get("help", one.help))
    if key == "workers":
        return workers_option
    name = one.key.replace("_", "-")
    is_on = one.kind is bool and bool(one.default)
    arguments: dict[str, Any] = {"help": one.help, **_describe_value(one), **changes}
    return click.option(one.option or f"--{'no-' * is_on}{name}", one.key, **arguments)


def _describe_value(one: Setting) -> dict[str, Any]:
    """Return the arguments of `click.option` for type, default and placeholder of a setting."""
    if one.kind is bool:
        return {"is_flag": True, **({"flag_value": False, "default": True} if one.default else {})}
    described: dict[str, Any] = {"metavar": one.metavar or one.unit.upper() or None}
    if one.is_choice:
        described["type"] = click.Choice([value.value for value in one.kind])
    elif one.kind in (int, float):
        limits: tuple[Any, Any] = one.bounds or (None, None)
        described["type"] = (click.IntRange if one.kind is int else FiniteRange)(*limits)
    elif one.kind is Path or one.key == "agent_config":
        described["type"] = click.Path(path_type=Path)
    elif one.kind is AgentLimits:
        return described | {"callback": _read_agent_limits}
    default = one.typed_default
    return described if default is None else {**described, "default": default, "show_default": default != ""}


def _read_agent_limits(_: click.Context, __: click.Parameter, value: str | None) -> AgentLimits | None:
    """Return the limits; None without the option. Raises InputError."""
    return None if value is None else parse_agent_limits(value)


def seed_options(*, seed: int = 0, seeds: int = 1, first: str, count: str) -> tuple[Option, Option]:
    """Return `--seed`, the first seed, and `--seeds`, how many; with these defaults and help texts."""
    return (
        click.option("--seed", type=click.IntRange(0, MAX_SEED), default=seed, show_default=True, help=first),
        click.option("--seeds", type=click.IntRange(1, MAX_SEEDS), default=seeds, show_default=True, help=count),
    )


def run_options(before: Mapping[str, Option]) -> Callable[[Command], Command]:
    """Return a decorator that adds the options of a run's settings. before: others, by the key that they precede."""
    options: list[Option] = []
    for key, one in _SETTINGS.items():
        options += [before[key]] if key in before else []
        options += _make_options(one)
    return add_options(options)


def _make_options(one: Setting) -> tuple[Option, ...]:
    if one.key == "seeds":
        return seed_options(first=_FIRST_SEED, count=one.help)
    changes = _CHANNEL_OPTIONS if one.key == "comm" else {}
    return (
        setting_option(one.key),
        *(click.option(f"--{name.replace('_', '-')}", name, **described) for name, described in changes.items()),
    )


_FIRST_SEED = "Seed of all randomness. 0: the scenarios as written. Others also draw starts, triggers and drivers."


def episode_options(command: Command) -> Command:
    """Add the options of an episode to a click command, which gives its `**options` to `read_episode_options`."""
    return episode_options_without()(command)


def episode_options_without(*keys: str) -> Callable[[Command], Command]:
    """Return a decorator as `episode_options`, for a command in which some settings can have only their default."""
    settings = [one for one in list_settings(EpisodeOptions) if one.key not in keys]
    return add_options([option for one in settings for option in _make_options(one)])


def read_episode_options(options: dict[str, Any]) -> EpisodeOptions:
    """Return the options of an episode and take them out of the dict. Raises InputError naming the option.

    Settings for which the command has no option have their default.
    """
    comm = read_channel(options)
    keys = [one.key for one in list_settings(EpisodeOptions) if one.key != "comm" and one.key in options]
    others: dict[str, Any] = {key: options.pop(key) for key in keys}
    return EpisodeOptions.parse(comm=comm, **others)


def read_channel(options: dict[str, Any]) -> CommSettings:
    """Return the channel and take its options out of the dict. Raises InputError naming the option.

    A sending rate that was not given goes, too: its default depends on the channel (`EpisodeOptions.parse`).
    """
    context = click.get_current_context(silent=True)
    if context is not None and context.get_parameter_source("v2x_rate") is ParameterSource.DEFAULT:
        options.pop("v2x_rate", None)
    return parse_comm_options(**{name: options.pop(name) for name in ("comm", *_CHANNEL_OPTIONS)})


def parse_comm_options(comm: str = "ideal", comm_mute: tuple[str, ...] = (), **given: str | None) -> CommSettings:
    """Return the channel of a preset with the given options changed (text; None: not given). Raises InputError."""
    if comm not in PRESETS:
        raise InputError(f"--comm: {describe_unknown(comm, PRESETS)}")
    comm_settings = PRESETS[comm]
    for name, text in given.items():
        if text is None:
            continue
        try:
            comm_settings = _set_option(comm_settings, name, text)
        except (ValueError, InputError) as error:
            why = str(error).removeprefix("V2X channel: ")
            raise InputError(f"--{name.replace('_', '-')} {text}: {why}") from None
    return replace(comm_settings, mute=(*comm_settings.mute, *comm_mute))


def _set_option(comm: CommSettings, option: str, text: str) -> CommSettings:
    if option == "comm_budget":
        return replace(comm, budget_bytes_s=_parse_number(text))
    if option in _RADIO_FIELDS:
        return replace(comm, radio=_set_radio_option(comm, option, text))
    parse = _PARSERS[option]
    for name, values in _split_by_type(text).items():
        fields = parse(values)
        if name:
            comm = replace(comm, by_type={**comm.by_type, name: replace(comm.find_link(name), **fields)})
        else:
            links = {other: replace(link, **fields) for other, link in comm.by_type.items()}
            comm = replace(comm, link=replace(comm.link, **fields), by_type=links)
    return comm


def _set_radio_option(comm: CommSettings, option: str, text: str) -> RadioSettings:
    if comm.radio is None:
        raise ValueError(f"expected a radio, --comm {' or '.join(RadioProfile)}, found --comm {comm.preset}")
    if option == "comm_corner":
        if text not in tuple(CornerModel):
            raise ValueError(f"expected one of {', '.join(CornerModel)}, found {text!r:.40}")
        return replace(comm.radio, corner_model=CornerModel(text))
    return replace(comm.radio, **{_RADIO_FIELDS[option]: _parse_number(text)})


_RADIO_FIELDS: Mapping[str, str] = {
    "comm_power": "power_dbm",
    "comm_gain": "antenna_gain_dbi",
    "comm_corner": "corner_model",
    "connected_background": "connected_background",
}


def _split_by_type(text: str) -> dict[str, list[str]]:
    """Split values by type of message, "" for all types: "0.6,0.6,cam=0,0" -> {"": [...], "cam": [...]}."""
    values_by_type: dict[str, list[str]] = {"": []}
    name = ""
    for part in text.split(","):
        key, equals, value = part.strip().rpartition("=")
        if equals:
            name = key.strip()
            if name not in TYPES or name in values_by_type:
                raise ValueError(f"expected each type of {', '.join(TYPES)} at most once, found {name!r:.40}")
        values_by_type.setdefault(name, []).append(value.strip())
    return {name: values for name, values in values_by_type.items() if values}


def _parse_number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"expected a number, found {text!r:.40}") from None


def _parse_latency(values: list[str]) -> dict[str, Any]:
    if len(values) != 1 or not (values[0].isascii() and values[0].isdecimal()):
        raise ValueError(f"expected a whole number of ticks, found {','.join(values)!r:.40}")
    return {"latency_ticks": int(values[0])}


def _make_number_parser(field: str) -> Callable[[list[str]], dict[str, Any]]:
    def parse(values: list[str]) -> dict[str, Any]:
        if len(values) != 1:
            raise ValueError(f"expected one number, found {','.join(values)!r:.40}")
        return {field: _parse_number(values[0])}

    return parse


def _parse_pose_error(values: list[str]) -> dict[str, Any]:
    per = values[2] if len(values) == 3 else PER[0]
    if len(values) not in (2, 3) or per not in PER:
        raise ValueError(f"expected POS_M,ROT_DEG or POS_M,ROT_DEG,episode, found {','.join(values)!r:.40}")
    return {"pose_error_m": _parse_number(values[0]), "pose_error_deg": _parse_number(values[1]), "pose_error_per": per}


_PARSERS: Mapping[str, Callable[[list[str]], dict[str, Any]]] = {
    "comm_latency": _parse_latency,
    "comm_loss": _make_number_parser("loss"),
    "comm_range": _make_number_parser("range_m"),
    "pose_error": _parse_pose_error,
}
