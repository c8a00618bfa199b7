"""SUMO's netconvert: find the program and run it."""

import importlib.util
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.posix import import_posix

if TYPE_CHECKING:
    import resource
else:
    resource = import_posix("resource")

LIMIT_S = 600
MEMORY_BYTES = 2 * 2**30
"""Address space of netconvert; for CARLA's largest town it holds 66 MB."""
OUT_OF_MEMORY = "std::bad_alloc"
"""What netconvert reports when it reaches that limit."""


def run_netconvert(
    arguments: Sequence[str], folder: Path, expected: str, output_option: str = "--output-file"
) -> bytes:
    """Run netconvert in `folder` and return the file it writes; raise InputError if it is missing or rejects its input.

    `expected` names the input and begins the error, such as "a.xodr: expected a map". `output_option` is the option
    that names the file: a net by default, an OpenDRIVE map with `--opendrive-output`.
    """
    with tempfile.TemporaryDirectory() as scratch:
        net = Path(scratch) / "map.net.xml"
        call = (str(find_netconvert()), *arguments, output_option, str(net))
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
    if (program := shutil.which("netconvert")) is None:
        raise InputError(f"netconvert: expected SUMO's programs, found none ({format_installation('convert')})")
    return Path(program)
