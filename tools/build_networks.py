"""Compile the shipped networks from their recipes: `python -m tools.build_networks [NAME...]`.

A recipe is a folder with hand-written plain XML (`plain.*.xml`) and `network.json`, which holds netconvert's arguments,
buildings and signs. The same netconvert release produces the same bytes: dates and comments are removed.
"""

import gzip
import re
import subprocess
import sys
import sysconfig
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from shutil import which

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import find_network_folder, list_packaged_networks
from mdrive_sumo.roads.network_file import (
    NET_FILE,
    NETWORK_FILE,
    NetworkFile,
    compute_net_checksum,
    read_network_file,
)


def netconvert() -> str | None:
    """Path of SUMO's netconvert, of this Python environment if it has one; None if there is none."""
    return which("netconvert", path=sysconfig.get_path("scripts")) or which("netconvert")


def compile_recipe(folder: Path) -> bytes:
    """Compile the recipe in `folder` to a net file (XML); raise InputError if netconvert is missing or rejects it."""
    program = netconvert()
    if program is None:
        raise InputError(f"{folder}: expected netconvert on the PATH (pip install eclipse-sumo), found none")
    with tempfile.TemporaryDirectory() as scratch:
        made = Path(scratch) / "map.net.xml"
        call = [program, *read_network_file(folder).build, "--output-file", str(made)]
        done = subprocess.run(call, cwd=folder, capture_output=True, text=True, check=False)
        if done.returncode != 0:
            raise InputError(f"{folder}: netconvert refused the recipe: {done.stderr.strip()[-300:]}")
        return strip_comments(made.read_bytes())


def strip_comments(xml: bytes) -> bytes:
    """Remove XML comments, in which netconvert writes the date and local paths."""
    return re.sub(rb"<!--.*?-->\s*", b"", xml, flags=re.DOTALL)


def build_network(folder: Path) -> NetworkFile:
    """Compile a recipe, write `map.net.xml.gz` and update offset and checksum in `network.json`."""
    net = compile_recipe(folder)
    (folder / NET_FILE).write_bytes(gzip.compress(net, 9, mtime=0))
    about = read_network_file(folder).model_copy(
        update={"offset": _read_offset(net), "checksum": compute_net_checksum(net)}
    )
    (folder / NETWORK_FILE).write_text(about.model_dump_json(indent=1) + "\n")
    return about


def _read_offset(net: bytes) -> tuple[float, float]:
    location = ET.fromstring(net).find("location")
    assert location is not None  # netconvert always writes it
    x, y = location.attrib["netOffset"].split(",")
    return float(x), float(y)


def main(names: list[str]) -> None:
    """Build the named networks, or all shipped ones."""
    for name in names or list_packaged_networks():
        about = build_network(find_network_folder(name))
        sys.stdout.write(f"{about.name} {about.checksum}\n")


if __name__ == "__main__":
    main(sys.argv[1:])
