"""SUMO's netconvert: find the program and run it."""

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
"""Without `--opendrive.internal-shapes`: it folds lanes in junctions (heading change 114 instead of 67 deg)."""


def build_opendrive_command(xodr: str, net: str) -> tuple[str, ...]:
    """Return the netconvert command that compiles an OpenDRIVE file to a net file."""
    return ("netconvert", "--opendrive-files", xodr, "--output-file", net, *OPENDRIVE_OPTIONS)


def compile_opendrive(xodr: Path) -> bytes:
    """Compile an OpenDRIVE map to a SUMO net; raise InputError if netconvert is missing or rejects the map."""
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
    """Return the path of netconvert, preferably that of this Python environment; raise InputError if there is none."""
    spec = importlib.util.find_spec("sumo")
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        if (wheel := Path(folder) / "bin" / "netconvert").is_file():
            return wheel
    if (found := shutil.which("netconvert")) is None:
        raise InputError("netconvert: expected SUMO's programs, found none (pip install 'mdrive-sumo[convert]')")
    return Path(found)
