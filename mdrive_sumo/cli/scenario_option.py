"""The option `--scenario` of every command that selects scenarios."""

from collections.abc import Callable
from typing import Any

import click


def join_patterns(_: click.Context, __: click.Parameter, value: tuple[str, ...]) -> str | None:
    """Return the patterns of all `--scenario` as one, separated by commas, as `Suite.select` reads it; None: none."""
    return ",".join(value) if value else None


def _join_or_all(ctx: click.Context, param: click.Parameter, value: tuple[str, ...]) -> str:
    return join_patterns(ctx, param, value) or "*"


def make_scenario_option(text: str = "Only scenarios whose id or category matches; may be repeated.") -> Callable[..., Any]:
    """Return an option that gives the patterns as one text, "*" by default."""
    return click.option("--scenario", multiple=True, metavar="GLOB", callback=_join_or_all, help=text)


scenario_option = make_scenario_option()
