"""`mdrive-sumo generate --season`."""

import signal
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from shutil import get_terminal_size
from typing import Any

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_text
from mdrive_sumo.core.terminal import echo, echo_live
from mdrive_sumo.generate.seasons.draw_season import BUCKETS, SeasonRequest, draw_season
from mdrive_sumo.generate.seasons.season_seed import parse_season
from mdrive_sumo.scenario.statistics import PAPER, compute_suite_statistics
from mdrive_sumo.scenario.suite import Suite

LEAST_SECRET = 16
"""Least length of a private seed [characters], so that it cannot be guessed."""
SEASON_ONLY = ("secret", "buckets", "per_group")
WITH_SEASON = ("season", "out", "workers", *SEASON_ONLY)


def season_options(function: Callable[..., None]) -> Callable[..., None]:
    """Add the options of a season to a command."""
    options = (
        click.option("--season", metavar="N", help="Draw season N, all 225 scenarios anew; with --secret also a word."),
        click.option(
            "--secret", type=click.Path(path_type=Path, dir_okay=False), help="season: file with a private seed."
        ),
        click.option(
            "--bucket", "buckets", multiple=True, type=click.Choice(BUCKETS), help="season: only this; may repeat."
        ),
        click.option("--per-category", "per_group", type=click.IntRange(1), hidden=True),
    )
    for option in reversed(options):
        function = option(function)
    return function


def check_season_options(options: Mapping[str, Any]) -> None:
    """Raise click.UsageError for options that do not go with --season, or only with it."""
    context = click.get_current_context()
    typed = [
        name for name in context.params if context.get_parameter_source(name) is click.core.ParameterSource.COMMANDLINE
    ]
    names = {one.name: one.opts[0] for one in context.command.params}
    for name in typed:
        if options["season"] is not None and name not in WITH_SEASON:
            raise click.UsageError(f"{names[name]} goes not with --season")
        if options["season"] is None and name in SEASON_ONLY:
            raise click.UsageError(f"{names[name]} goes only with --season")


def read_secret(path: Path) -> str:
    """Return the private seed of a file. Raises InputError, also for one that is too short."""
    wanted = f"{path}: expected a private seed of {LEAST_SECRET} characters or more"
    try:
        secret = read_text(path).strip()
    except OSError as error:
        raise InputError(f"{wanted}, found no file to read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{wanted}, found bytes that are no text") from None
    if len(secret) < LEAST_SECRET:
        raise InputError(f"{wanted}, found {len(secret)}")
    return secret


def generate_season(ctx: click.Context, options: Mapping[str, Any], out: Path) -> int:
    """Draw a season and return the exit code; Ctrl-C ends the command with 130."""
    seed = parse_season(options["season"], read_secret(options["secret"]) if options["secret"] else "")
    request = SeasonRequest(seed, out, options["buckets"] or BUCKETS, options["workers"], options["per_group"])
    display = SeasonDisplay()
    try:
        suites = draw_season(request, display)
    except KeyboardInterrupt:
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C must not swallow the answer to the first
        display.close()
        echo(f"interrupted; the same command continues {request.work}", err=True)
        ctx.exit(130)
    display.close()
    for suite in suites:
        echo(_describe_suite(suite))
    return 0


def _describe_suite(suite: Suite) -> str:
    found = compute_suite_statistics(suite.scenarios)
    paper = PAPER.get(suite.about.name)
    aims = ("", "", "", "") if paper is None else (
        f" ({paper.mean_cavs:.2f})", f" ({paper.mean_route_m:.1f})", f" ({paper.mean_heading_change_deg:.1f})",
        f" ({paper.mean_actors:.2f})",
    )  # fmt: skip
    return (
        f"{suite.folder}: {found.scenarios} scenarios; means (paper): CAVs {found.mean_cavs:.2f}{aims[0]},"
        f" route {found.mean_route_m:.1f}{aims[1]} m, heading change {found.mean_heading_change_deg:.1f}{aims[2]} deg,"
        f" actors {found.mean_actors:.2f}{aims[3]}"
    )


class SeasonDisplay:
    """Progress on standard error: one live line on a terminal, one line per candidate elsewhere."""

    def __init__(self) -> None:
        self._live = sys.stderr.isatty()

    def note(self, text: str) -> None:
        """See SeasonProgress."""
        if self._live:
            echo_live(text[: max(get_terminal_size().columns, 40) - 1])
        else:
            echo(text, err=True)

    def close(self) -> None:
        """Clear the live line."""
        if self._live:
            echo_live("")
