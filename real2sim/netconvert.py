"""OpenDRIVE maps through SUMO's netconvert."""

from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads.netconvert import OUT_OF_MEMORY, run_netconvert

RESOLUTIONS_M = (1.0, 2.0)
"""[m] Steps of curves: the finer one, and netconvert's own for maps that need too much memory with that."""
OPENDRIVE_OPTIONS = (
    "--junctions.internal-link-detail",  # 5 points make a turn of 22-degree kinks
    "20",
    "--no-turnarounds.except-deadend",
    "--precision",  # of 3 digits the offset too is exact to the millimetre
    "3",
)
"""Without `--opendrive.internal-shapes`: it folds lanes in junctions (heading change 114 instead of 67 deg)."""


def _list_options(resolution_m: float) -> tuple[str, ...]:
    return ("--opendrive.curve-resolution", f"{resolution_m:.1f}", *OPENDRIVE_OPTIONS)


def build_opendrive_command(xodr: str, net: str, resolution_m: float = RESOLUTIONS_M[0]) -> tuple[str, ...]:
    """Return the netconvert command that compiles an OpenDRIVE file to a net file."""
    return ("netconvert", "--opendrive-files", xodr, "--output-file", net, *_list_options(resolution_m))


def compile_opendrive(xodr: Path, named: Path | None = None) -> tuple[bytes, float]:
    """Compile an OpenDRIVE map; return the SUMO net and the step of its curves [m].

    `named` is the file that errors name, if `xodr` is a repaired copy. Raises InputError if netconvert is missing or
    rejects the map.
    """
    expected = f"{named or xodr}: expected a map"
    for resolution_m in RESOLUTIONS_M:
        arguments = ("--opendrive-files", str(xodr.resolve()), *_list_options(resolution_m))
        try:
            return run_netconvert(arguments, xodr.parent, expected), resolution_m
        except InputError as error:
            if OUT_OF_MEMORY not in str(error) or resolution_m == RESOLUTIONS_M[-1]:
                raise
    raise AssertionError("one of the resolutions returns or raises")
