"""Options of an episode for every command that drives: V2X channel, agents' clock, scripted actors, friction."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any, TypeVar

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.loop.episode_config import EpisodeOptions
from mdrive_sumo.v2x.comm_settings import PER, PRESETS, CommSettings
from mdrive_sumo.v2x.messages import TYPES

Command = TypeVar("Command", bound=Callable[..., Any])
_EACH = "for all types of message, or for some: "

_OPTIONS = (
    click.option("--comm", default="ideal", show_default=True, metavar="|".join(PRESETS), help="The V2X channel."),
    click.option("--comm-latency", metavar="TICKS", help=f"Delay, {_EACH}6,text=20 or cpm=2."),
    click.option("--comm-loss", metavar="P", help=f"Probability of loss, {_EACH}0.1,cam=0."),
    click.option("--comm-range", metavar="M", help=f"Reach in metres or inf, {_EACH}200,cpm=70."),
    click.option("--comm-budget", metavar="BYTES_PER_S", help="Bytes that a station may send per second, or inf."),
    click.option(
        "--pose-error",
        metavar="POS_M,ROT_DEG[,episode]",
        help=f"Standard deviations of senders' poses, drawn per message or episode, {_EACH}0.6,0.6,cam=0,0.",
    ),
    click.option(
        "--comm-mute",
        multiple=True,
        metavar="SENDER/TYPE[@TICK]",
        help="Drop these messages; * is any. SENDER: an id of the scenarios.",
    ),
    click.option(
        "--agent-clock",
        default="ideal",
        show_default=True,
        metavar="ideal|fixed:MS|measured",
        help="Cost of think time.",
    ),
)


def episode_options(command: Command) -> Command:
    """Add the options of an episode to a click command, which gives its `**options` to `read_episode_options`."""
    for option in reversed((*_OPTIONS, *_make_choice_options())):
        command = option(command)
    return command


def _make_choice_options() -> Iterator[Callable[[Any], Any]]:
    """Yield an option for every field of `EpisodeOptions` with a fixed set of values."""
    for key, (name, kind, text) in EpisodeOptions.list_choices().items():
        default = str(getattr(EpisodeOptions(), name))
        yield click.option(
            f"--{key}",
            type=click.Choice([value.value for value in kind]),
            default=default,
            show_default=True,
            help=text,
        )


def read_episode_options(options: dict[str, Any]) -> EpisodeOptions:
    """Return the options of an episode and take them out of the dict. Raises InputError naming the option."""
    names = ("comm", "comm_latency", "comm_loss", "comm_range", "comm_budget", "pose_error", "comm_mute")
    comm = parse_comm_options(**{name: options.pop(name) for name in names})
    others: dict[str, Any] = {key: options.pop(key) for key in ("agent_clock", *EpisodeOptions.list_choices())}
    return EpisodeOptions.parse(comm=comm, **others)


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
    parse = _PARSERS[option]
    for name, values in _split_by_type(text).items():
        fields = parse(values)
        if name:
            comm = replace(comm, by_type={**comm.by_type, name: replace(comm.find_link(name), **fields)})
        else:
            links = {other: replace(link, **fields) for other, link in comm.by_type.items()}
            comm = replace(comm, link=replace(comm.link, **fields), by_type=links)
    return comm


def _split_by_type(text: str) -> dict[str, list[str]]:
    """Split values by type of message, "" for all types: "0.6,0.6,cam=0,0" -> {"": [...], "cam": [...]}."""
    found: dict[str, list[str]] = {"": []}
    name = ""
    for part in text.split(","):
        key, equals, value = part.strip().rpartition("=")
        if equals:
            name = key.strip()
            if name not in TYPES or name in found:
                raise ValueError(f"expected each type of {', '.join(TYPES)} at most once, found {name!r:.40}")
        found.setdefault(name, []).append(value.strip())
    return {name: values for name, values in found.items() if values}


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
