"""A group of commands to which other packages add some, through entry points; each is imported when it is called."""

from collections.abc import Mapping
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points

import click

from mdrive_sumo.cli.strict_parsing import make_strict


class PlugInGroup(click.Group):
    """A group with its own commands and those of an entry-point group.

    The library knows neither the packages behind the entry points nor what they import: it runs without them.
    """

    def __init__(self, name: str, entry_point_group: str, **attributes: str) -> None:
        super().__init__(name, help=attributes["help"])
        self._entry_point_group = entry_point_group

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the own commands, then those of other packages."""
        own = super().list_commands(ctx)
        return [*own, *(name for name in sorted(self._find_plug_ins()) if name not in own)]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command; one of another package is imported now."""
        own = super().get_command(ctx, cmd_name)
        plug_in = self._find_plug_ins().get(cmd_name)
        return own if own is not None or plug_in is None else make_strict(plug_in.load())

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one line per command without importing those of other packages."""
        own = {name: command.get_short_help_str(100) for name, command in sorted(self.commands.items())}
        plugged = {name: self._find_line(ctx, entry) for name, entry in sorted(self._find_plug_ins().items())}
        with formatter.section("Commands"):
            formatter.write_dl([*(own | {name: line for name, line in plugged.items() if name not in own}).items()])

    def _find_plug_ins(self) -> dict[str, EntryPoint]:
        return {entry.name: entry for entry in entry_points(group=self._entry_point_group)}

    def _find_line(self, ctx: click.Context, plug_in: EntryPoint) -> str:
        """Return the help line of a plug-in: in `COMMANDS` of its package by "GROUP COMMAND"."""
        lines: Mapping[str, str] = getattr(import_module(plug_in.module.partition(".")[0]), "COMMANDS", {})
        return lines.get(f"{ctx.info_name} {plug_in.name}", "")
