"""Common parts of the commands for logs: options, search for logs in folders, running the batch."""

import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from shutil import get_terminal_size
from typing import TYPE_CHECKING, Any, TypeVar

import click

from mdrive_sumo.cli.options import workers_option
from mdrive_sumo.core.clean_text import clean_line
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo, echo_live
from real2sim.pipeline.log_source import LogSource

if TYPE_CHECKING:  # commands import what they run: `--help` must not load SUMO, pydantic and scipy
    from mdrive_sumo.scenario.background import BackgroundMode
    from real2sim.logged_drive import ConfirmedInfraction
    from real2sim.pipeline.batch import BatchResult
    from real2sim.readers.time_grid import TimeWindow

F = TypeVar("F", bound=Callable[..., Any])
TRAFFIC_MODES = ("reactive", "replay", "hybrid")
INDEX_FILES = frozenset(("dataset_summary.pkl", "dataset_mapping.pkl"))
"""Index files that ScenarioNet writes next to its scenarios."""


def parse_window(_: click.Context, __: click.Parameter, value: str | None) -> "TimeWindow | None":
    """Parse the option --window."""
    if value is None:
        return None
    try:
        start, end = (float(part) for part in value.split(","))
    except ValueError:
        raise click.BadParameter(f"expected START,END in seconds, found {value!r}") from None
    if not 0 <= start < end < float("inf"):
        raise click.BadParameter(f"expected 0 <= START < END, found {value!r}")
    return start, end


def parse_cavs(_: click.Context, __: click.Parameter, value: str) -> tuple[str, ...]:
    """Parse the option --cavs; `auto` gives ()."""
    names = tuple(part.strip() for part in value.split(","))
    if not all(names):
        raise click.BadParameter(f"expected names between commas, or auto, found {value!r}")
    return () if names == ("auto",) else names


paths_argument = click.argument("paths", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="PATH...")
out_option = click.option(
    "--out", type=click.Path(path_type=Path), required=True, metavar="DIR", help="New suite folder."
)
name_option = click.option("--name", metavar="NAME", help="Name of the suite [default: that of --out].")
_OPTIONS = (
    paths_argument,
    out_option,
    name_option,
    click.option("--window", callback=parse_window, metavar="START,END", help="Only this part of each log [s]."),
    click.option(
        "--every",
        "every_s",
        type=click.FloatRange(2.0, 60.0),
        metavar="SECONDS",
        help="Cut each log, or its window, into scenarios of this length.",
    ),
    click.option(
        "--cavs",
        default="auto",
        show_default=True,
        callback=parse_cavs,
        metavar="ID,...|auto",
        help="Agents or tracks that are driven; auto: those of the source, else the vehicle that is there longest.",
    ),
    click.option(
        "--traffic",
        type=click.Choice(TRAFFIC_MODES),
        default=TRAFFIC_MODES[0],
        show_default=True,
        help="SUMO drives along the log; its poses, never reacting; its poses until a CAV is in the way.",
    ),
    click.option(
        "--confirmed",
        type=click.Path(path_type=Path),
        metavar="FILE",
        help="TOML file of infractions of logged drives that a person has confirmed on the picture.",
    ),
    click.option("--report", is_flag=True, help="Write pages: raw against reconstructed, verdicts."),
    workers_option,
)


def log_options(command: F) -> F:
    """Add PATH... and the options common to all log sources."""
    for option in reversed(_OPTIONS):
        command = option(command)
    return command


@dataclass(frozen=True)
class LogCliOptions:
    """Options of one `convert` command for logs, see `log_options`."""

    paths: tuple[Path, ...]
    out: Path
    name: str | None
    window: "TimeWindow | None"
    every_s: float | None
    cavs: tuple[str, ...]
    traffic: "BackgroundMode"
    confirmed: Path | None
    report: bool
    workers: int


def _find_no_cases(_: Path) -> tuple[str, ...]:
    return ("",)


@dataclass(frozen=True, slots=True)
class LogPattern:
    """What the logs of a source look like in the file system."""

    is_log: Callable[[Path], bool]
    wanted: str
    """What a folder without any log should have, for the error."""
    find_cases: Callable[[Path], tuple[str, ...]] = _find_no_cases
    """Return the names of the logs in one file."""


def run_conversion(
    ctx: click.Context,
    source: str,
    pattern: LogPattern,
    options: Mapping[str, Any],
    *,
    maps: tuple[Path, ...] = (),
    agents: tuple[str, ...] | None = None,
) -> None:
    """Find and convert the logs of a source, print the results and exit with the exit code.

    source: a key of `READERS`. options: those of `log_options`. maps, agents: see `LogSource`.
    """
    cli_options = LogCliOptions(**options)
    paths = find_logs(cli_options.paths, pattern)
    logs = [
        LogSource(source, path, maps, agents, cli_options.window, case)
        for path in paths
        for case in pattern.find_cases(path)
    ]
    from real2sim.pipeline.batch import BatchOptions, NoLogConvertedError, convert_logs
    from real2sim.pipeline.conversion_options import ConversionOptions

    conversion = ConversionOptions(
        cli_options.traffic, cli_options.cavs, confirmed=_load_confirmed(cli_options.confirmed)
    )
    order = BatchOptions(conversion, cli_options.report, cli_options.every_s, cli_options.workers, show_progress)
    name = check_suite_name(cli_options.out, cli_options.name)
    try:
        batch = convert_logs(logs, cli_options.out, name, order)
    except NoLogConvertedError as error:
        _echo_refused(error.refused or (str(error),))
        ctx.exit(2)
    echo(format_batch(batch, cli_options))
    _echo_refused(batch.refused)
    ctx.exit(2 if batch.refused else 1 if batch.below_target else 0)


def _echo_refused(sentences: Sequence[str]) -> None:
    """Print a line for each log that cannot be converted."""
    for sentence in sentences:
        echo(f"Error: {clean_line(sentence)}", err=True)


def _load_confirmed(path: Path | None) -> "tuple[ConfirmedInfraction, ...]":
    if path is None:
        return ()
    from real2sim.logged_drive import load_confirmed_infractions

    return load_confirmed_infractions(path)


def check_suite_name(out: Path, name: str | None) -> str:
    """Return the name of a suite, that of its folder if none is given; raise InputError for an invalid one."""
    wanted = name or re.sub(r"[^A-Za-z0-9_.+-]", "_", out.resolve().name).lstrip("_.+-") or "suite"
    if not re.fullmatch(r"[A-Za-z0-9][A-Za-z0-9_.+-]{0,79}", wanted):
        raise InputError(f"--name: expected letters, digits and _.+-, at most 80, found {wanted!r}")
    return wanted


def format_batch(batch: "BatchResult", cli_options: LogCliOptions) -> str:
    """Format what was written, and which targets are missed."""

    lines = [f"{outcome.id}: {miss}" for outcome in batch.below_target for miss in outcome.misses]
    passed, converted = len(batch.outcomes) - len(batch.below_target), len(batch.outcomes)
    lines.append(
        f"{passed} of {converted} scenarios meet every target"
        + f"; {len(batch.refused)} {'log' if len(batch.refused) == 1 else 'logs'} unusable" * bool(batch.refused)
    )
    if cli_options.report:
        lines.append(f"Report: {cli_options.out / 'conversion.html'}")
    lines += [
        f"Figures: mdrive-sumo convert --summary {cli_options.out}",
        f"Run it: mdrive-sumo eval --suite {cli_options.out}",
    ]
    return "\n".join(lines)


def show_progress(done: int, total: int, text: str) -> None:
    """Show progress on standard error: a live bar on a terminal, one line per log elsewhere."""
    if not sys.stderr.isatty():
        echo(f"{done}/{total}  {text}", err=True)
        return
    bar = "█" * (24 * done // total)
    width = max(get_terminal_size().columns, 40) - 1
    line = f"{bar:░<24} {done}/{total}  {text}"[:width]
    echo_live(line if done < total else "")


def find_logs(paths: Sequence[Path], pattern: LogPattern) -> list[Path]:
    """Return every path that is a log, or else the logs below it; readers report files that are no logs.

    Raises InputError for a folder without any log.
    """
    logs: list[Path] = []
    for path in paths:
        below = _find_logs_in(path, pattern.is_log)
        if not below and path.is_dir():
            raise InputError(f"{path}: expected {pattern.wanted} in it or below, found none")
        logs += below or [path]
    return logs


def _find_logs_in(path: Path, is_log: Callable[[Path], bool]) -> list[Path]:
    if is_log(path) or not path.is_dir():
        return [path] if is_log(path) else []
    return [log for below in sorted(path.iterdir()) for log in _find_logs_in(below, is_log)]


def match_file(*names: str) -> LogPattern:
    """Return the pattern of files of one of those names."""
    return LogPattern(
        lambda path: path.is_file() and any(map(path.match, names)) and path.name not in INDEX_FILES, " or ".join(names)
    )


def match_folder(*names: str) -> LogPattern:
    """Return the pattern of folders that contain a file of such a name."""
    return LogPattern(lambda path: path.is_dir() and any(any(path.glob(name)) for name in names), " or ".join(names))


def _is_v2xpnp_folder(path: Path) -> bool:
    """Return whether a path is a V2XPnP scenario: a folder of numbered folders."""
    return path.is_dir() and any(re.fullmatch(r"-?[0-9]+", p.name) for p in path.iterdir() if p.is_dir())


V2XPNP_FOLDER = LogPattern(_is_v2xpnp_folder, "numbered agent folders")
