"""Compile the shipped networks from their recipes: `python -m tools.build_networks [NAME...]`.

A recipe is a folder with hand-written plain XML (`plain.*.xml`) and `network.json`, which holds netconvert's arguments,
buildings and signs. The same netconvert release produces the same bytes: dates and comments are removed.
"""

import gzip
import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from pathlib import Path

import click

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
from tools.tool_command import HELP, ToolCommand, dry_run_option, replace_changed_files


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


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("names", nargs=-1, metavar="[NAME]...")
@dry_run_option
def main(names: Sequence[str], dry_run: bool) -> None:
    """Compile the named packaged networks from their recipes, or all of them."""
    folders = [find_network_folder(name) for name in names or list_packaged_networks()]
    for folder in folders:
        with tempfile.TemporaryDirectory() as scratch:
            draft = Path(shutil.copytree(folder, Path(scratch, folder.name)))
            build_network(draft)
            replace_changed_files(draft, folder, dry_run=dry_run)


if __name__ == "__main__":
    main()
