"""What many commands share: `--workers`, `--scenario`, numbers between bounds, their own words. No simulator."""

import math
import sys
from collections.abc import Callable
from typing import Any

import click

from mdrive_sumo.core.posix import check_posix


def parse_worker_count(_: click.Context, __: click.Parameter, value: str) -> int:
    """Return the value of --workers: a positive number; "auto" is every core that this process may use."""
    if value == "auto":
        from mdrive_sumo.runs.process_pool import (
            count_available_cores,  # here, so that `convert --help` need not import it
        )

        return count_available_cores()
    if not value.isdecimal() or int(value) < 1:
        raise click.BadParameter(f"expected a positive number or auto, found {value!r}")
    if int(value) > 1:
        check_posix(f"--workers {value}: more than one worker")
    return int(value)


workers_option = click.option(
    "--workers",
    default="auto",
    show_default=True,
    metavar="N|auto",
    callback=parse_worker_count,
    help="Worker processes; auto: one a core.",
)


def _join_patterns(_: click.Context, __: click.Parameter, value: tuple[str, ...]) -> str:
    """Return the patterns of all `--scenario` as one, separated by commas, as `Suite.select` reads it."""
    return ",".join(value) or "*"


def make_scenario_option(text: str) -> Callable[..., Any]:
    """Return an option that gives the patterns as one text, "*" by default."""
    return click.option("--scenario", multiple=True, metavar="GLOB", callback=_join_patterns, help=text)


scenario_option = make_scenario_option("Only scenarios whose id or category matches; may be repeated.")


class FiniteRange(click.FloatRange):
    """`click.FloatRange` without NaN, which is neither below nor above a bound."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number. Raises click.BadParameter."""
        number = super().convert(value, param, ctx)
        if math.isnan(number):
            self.fail(f"expected a number, found {value!r}", param, ctx)
        return number


def get_command_line() -> tuple[str, ...]:
    """Return the command as the user typed it, for results and reports."""
    return ("mdrive-sumo", *sys.argv[1:])
