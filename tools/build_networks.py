"""Compile the shipped networks from their recipes: `python -m tools.build_networks [NAME...]`.

A recipe is a folder with hand-written plain XML (`plain.*.xml`) and `network.json`, which holds netconvert's arguments,
buildings and signs. The same netconvert release produces the same bytes: dates and comments are removed.
"""

import gzip
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

from mdrive_sumo.core.output_files import write_bytes, write_text
from mdrive_sumo.roads import find_network_folder, list_packaged_networks
from mdrive_sumo.roads.netconvert import run_netconvert, strip_xml_comments
from mdrive_sumo.roads.network_file import (
    NET_FILE,
    NETWORK_FILE,
    NetworkFile,
    compute_net_checksum,
    read_network_file,
)


def compile_recipe(folder: Path) -> bytes:
    """Compile the recipe in `folder` to a net file (XML); raise InputError if netconvert is missing or rejects it."""
    return strip_xml_comments(run_netconvert(read_network_file(folder).build, folder, f"{folder}: expected a recipe"))


def build_network(folder: Path) -> NetworkFile:
    """Compile a recipe, write `map.net.xml.gz` and update offset and checksum in `network.json`."""
    net = compile_recipe(folder)
    write_bytes(folder / NET_FILE, gzip.compress(net, 9, mtime=0))
    about = read_network_file(folder).model_copy(
        update={"offset": _read_offset(net), "checksum": compute_net_checksum(net)}
    )
    write_text(folder / NETWORK_FILE, about.model_dump_json(indent=1) + "\n")
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
