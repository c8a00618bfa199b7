"""SUMO's netconvert, found in the environment of the running interpreter."""

import importlib.util
import shutil
import subprocess
import tempfile
from pathlib import Path

from mdrive_sumo.core.errors import InputError

OPENDRIVE_OPTIONS = (
    "--opendrive.curve-resolution",
    "1.0",
    "--junctions.internal-link-detail",  # 5 points make a turn of 22-degree kinks
    "20",
    "--no-turnarounds.except-deadend",
    "--precision",  # of 3 digits the offset too is exact to the millimetre
    "3",
)
"""Not `--opendrive.internal-shapes`: it folds lanes in junctions (heading change 114 instead of 67 deg)."""


def build_opendrive_command(xodr: str, net: str) -> tuple[str, ...]:
    """Arguments that turn one OpenDRIVE file into one net."""
    return ("netconvert", "--opendrive-files", xodr, "--output-file", net, *OPENDRIVE_OPTIONS)


def compile_opendrive(xodr: Path) -> bytes:
    """The SUMO net of an OpenDRIVE map; raises InputError if netconvert is missing or refuses the map."""
    with tempfile.TemporaryDirectory() as folder:
        net = Path(folder) / "map.net.xml"
        arguments = build_opendrive_command(str(xodr.resolve()), str(net))
        done = subprocess.run(
            (str(find_netconvert()), *arguments[1:]), capture_output=True, text=True, check=False, timeout=600
        )
        if done.returncode or not net.is_file():
            errors = [line for line in done.stderr.splitlines() if line.startswith("Error: ")]
            why = errors[0].removeprefix("Error: ") if errors else f"exit code {done.returncode}"
            raise InputError(f"{xodr}: expected a map that netconvert accepts, found: {why}")
        return net.read_bytes()


def find_netconvert() -> Path:
    """Path of netconvert, of this Python environment if it has one; raises InputError if there is none."""
    spec = importlib.util.find_spec("sumo")
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        if (wheel := Path(folder) / "bin" / "netconvert").is_file():
            return wheel
    if (found := shutil.which("netconvert")) is None:
        raise InputError("netconvert: expected SUMO's programs, found none (pip install 'mdrive-sumo[convert]')")
    return Path(found)
