"""Recipes of networks: a folder with plain XML and `network.json`, which netconvert compiles.

`network.json` holds netconvert's arguments, buildings and signs. The same netconvert release makes the same bytes:
dates and comments are removed.
"""

import gzip
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

from mdrive_sumo.core.geometry import build_polyline
from mdrive_sumo.core.output_files import write_bytes, write_text
from mdrive_sumo.roads.netconvert import run_netconvert, strip_xml_comments
from mdrive_sumo.roads.network_file import (
    NET_FILE,
    NETWORK_FILE,
    NetworkFile,
    compute_net_checksum,
    read_network_file,
)
from mdrive_sumo.worlds.places.network_draft import NetworkDraft


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


def build_draft(draft: NetworkDraft, folder: Path) -> NetworkFile:
    """Write the recipe of a draft into `folder` and compile it; return what `network.json` then says."""
    draft.write_recipe(folder)
    about = build_network(folder)
    if draft.stops or draft.yields:
        draft.add_signs(folder, _measure_car_lanes(folder))
        return read_network_file(folder)
    return about


def _measure_car_lanes(folder: Path) -> dict[str, float]:
    """Return the length [m] of the centre line of each lane for cars outside junctions, by id."""
    root = ET.fromstring(gzip.decompress((folder / NET_FILE).read_bytes()))
    lengths: dict[str, float] = {}
    for lane in (lane for edge in root.iter("edge") if edge.get("function") is None for lane in edge.iter("lane")):
        if _is_for_cars(lane.attrib):
            points = [point.split(",") for point in lane.attrib["shape"].split()]
            line = build_polyline([(float(point[0]), float(point[1])) for point in points])
            lengths[lane.attrib["id"]] = line.length
    return lengths


def _is_for_cars(lane: Mapping[str, str]) -> bool:
    allowed, forbidden = lane.get("allow", "").split(), lane.get("disallow", "").split()
    return "passenger" in allowed if allowed else not {"passenger", "all"} & set(forbidden)
