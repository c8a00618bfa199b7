"""The command `mdrive-sumo convert`."""

from real2sim.cli.convert_command import convert

__all__ = ["convert"]
