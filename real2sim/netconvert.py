"""SUMO's netconvert: find the program and run it."""

import importlib.util
import re
import resource
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from mdrive_sumo.core.errors import InputError

LIMIT_S = 600
MEMORY_BYTES = 2 * 2**30
"""Address space of netconvert; for CARLA's largest town it holds 66 MB."""
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


def run_netconvert(arguments: Sequence[str], folder: Path, expected: str) -> bytes:
    """Run netconvert in `folder` and return the net file; raise InputError if it is missing or rejects its input.

    `expected` names the input and begins the error, such as "a.xodr: expected a map".
    """
    with tempfile.TemporaryDirectory() as scratch:
        net = Path(scratch) / "map.net.xml"
        call = (str(find_netconvert()), *arguments, "--output-file", str(net))
        exit_code, messages = _run_limited(call, folder, expected)
        if exit_code or not net.is_file():
            errors = [line for line in messages.splitlines() if line.startswith("Error: ")]
            reason = errors[0].removeprefix("Error: ") if errors else f"exit code {exit_code}"
            raise InputError(f"{expected} that netconvert accepts, found: {reason}")
        return net.read_bytes()


def _run_limited(call: Sequence[str], folder: Path, expected: str) -> tuple[int, str]:
    """Return exit code and messages of a command with limits: a road of 1e9 m would fill the memory of the machine."""
    with subprocess.Popen(
        call, cwd=folder, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True, errors="replace"
    ) as process:
        if sys.platform == "linux":
            resource.prlimit(process.pid, resource.RLIMIT_AS, (MEMORY_BYTES, MEMORY_BYTES))
        try:
            messages = process.communicate(timeout=LIMIT_S)[1]
            return process.returncode, messages
        except subprocess.TimeoutExpired:
            process.kill()
            raise InputError(f"{expected} that netconvert compiles within {LIMIT_S} s, found no end") from None


def strip_xml_comments(xml: bytes) -> bytes:
    """Remove XML comments, in which netconvert writes the date and local paths."""
    return re.sub(rb"<!--.*?-->\s*", b"", xml, flags=re.DOTALL)


def find_netconvert() -> Path:
    """Return the path of netconvert, preferably that of this Python environment; raise InputError if there is none."""
    spec = importlib.util.find_spec("sumo")
    for folder in (spec.submodule_search_locations or ()) if spec else ():
        if (wheel := Path(folder) / "bin" / "netconvert").is_file():
            return wheel
    if (found := shutil.which("netconvert")) is None:
        raise InputError("netconvert: expected SUMO's programs, found none (pip install 'mdrive-sumo[convert]')")
    return Path(found)
