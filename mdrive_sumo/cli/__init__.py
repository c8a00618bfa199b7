"""The command line: `mdrive-sumo COMMAND`."""

from mdrive_sumo.cli.command_line import COMMANDS, main

__all__ = ["COMMANDS", "main"]
