"""Commands of other packages, found by entry points; each is imported when it is called."""

from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points

import click

from mdrive_sumo.core.errors import InputError

EXTRAS = {"server": "server", "real2sim": "convert"}
"""Packages of this distribution whose commands need an extra."""


def find_plug_ins(group: str) -> dict[str, EntryPoint]:
    """Return the commands of an entry-point group by name."""
    return {entry.name: entry for entry in entry_points(group=group)}


def load_command(plug_in: EntryPoint) -> click.Command:
    """Return the command of another package. Raises InputError if a package that it needs is not installed."""
    from mdrive_sumo.core.installation_command import format_installation

    package = plug_in.module.partition(".")[0]
    try:
        return plug_in.load()
    except ModuleNotFoundError as error:
        missing = (error.name or "").partition(".")[0]
        if missing in ("", package, "mdrive_sumo"):
            raise
        remedy = format_installation(EXTRAS[package]) if package in EXTRAS else f"pip install {missing}"
        raise InputError(f"{plug_in.name}: expected the package {missing}, found none; {remedy}") from None


def find_help_line(plug_in: EntryPoint, name: str) -> str:
    """Return the help line of a plug-in: from `COMMANDS` of its package, else from the package's docstring.

    name: that of the command there, such as "drive" or "study human".
    """
    package = import_module(plug_in.module.partition(".")[0])
    help_lines: Mapping[str, str] = getattr(package, "COMMANDS", {})
    return help_lines.get(name) or (package.__doc__ or "").strip().partition("\n")[0]
