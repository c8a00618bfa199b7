"""The option `--scenario` of every command that selects scenarios."""

from collections.abc import Callable
from typing import Any

import click


def _join_patterns(_: click.Context, __: click.Parameter, value: tuple[str, ...]) -> str:
    """Return the patterns of all `--scenario` as one, separated by commas, as `Suite.select` reads it."""
    return ",".join(value) or "*"


def make_scenario_option(text: str) -> Callable[..., Any]:
    """Return an option that gives the patterns as one text, "*" by default."""
    return click.option("--scenario", multiple=True, metavar="GLOB", callback=_join_patterns, help=text)


scenario_option = make_scenario_option("Only scenarios whose id or category matches; may be repeated.")
