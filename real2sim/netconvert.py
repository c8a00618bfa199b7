"""OpenDRIVE maps through SUMO's netconvert."""

from pathlib import Path

from mdrive_sumo.roads.netconvert import run_netconvert

OPENDRIVE_OPTIONS = (
    "--opendrive.curve-resolution",
    "1.0",
    "--junctions.internal-link-detail",  # 5 points make a turn of 22-degree kinks
    "20",
    "--no-turnarounds.except-deadend",
    "--precision",  # of 3 digits the offset too is exact to the millimetre
    "3",
)
"""Without `--opendrive.internal-shapes`: it folds lanes in junctions (heading change 114 instead of 67 deg)."""


def build_opendrive_command(xodr: str, net: str) -> tuple[str, ...]:
    """Return the netconvert command that compiles an OpenDRIVE file to a net file."""
    return ("netconvert", "--opendrive-files", xodr, "--output-file", net, *OPENDRIVE_OPTIONS)


def compile_opendrive(xodr: Path) -> bytes:
    """Compile an OpenDRIVE map to a SUMO net; raise InputError if netconvert is missing or rejects the map."""
    return run_netconvert(
        ("--opendrive-files", str(xodr.resolve()), *OPENDRIVE_OPTIONS), xodr.parent, f"{xodr}: expected a map"
    )
