"""A group of commands to which other packages add some, through entry points."""

import click

from mdrive_sumo.cli.plug_in_commands import find_help_line, find_plug_ins, load_command
from mdrive_sumo.cli.strict_parsing import make_strict

SHORT_HELP_LENGTH = 100
"""Characters of the line of a command in the help of its group."""


class PlugInGroup(click.Group):
    """A group with its own commands and those of an entry-point group.

    The library knows neither the packages behind the entry points nor what they import: it runs without them.
    """

    def __init__(self, name: str, entry_point_group: str, help_text: str) -> None:
        super().__init__(name, help=help_text)
        self._entry_point_group = entry_point_group

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the own commands, then those of other packages."""
        own = super().list_commands(ctx)
        return [*own, *(name for name in sorted(find_plug_ins(self._entry_point_group)) if name not in own)]

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Return a command; one of another package is imported now. Raises InputError if it lacks a package."""
        own = super().get_command(ctx, cmd_name)
        plug_in = find_plug_ins(self._entry_point_group).get(cmd_name)
        return own if own is not None or plug_in is None else make_strict(load_command(plug_in))

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write one line per command without importing those of other packages."""
        plug_ins = find_plug_ins(self._entry_point_group)
        lines = {
            name: self.commands[name].get_short_help_str(SHORT_HELP_LENGTH)
            if name in self.commands
            else find_help_line(plug_ins[name], f"{ctx.info_name} {name}")
            for name in self.list_commands(ctx)
        }
        with formatter.section("Commands"):
            formatter.write_dl([*lines.items()])
