"""An OpenStreetMap extract becomes a network: roads by netconvert, buildings and signs by their tags."""

from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import NetworkFile, RoadMap
from real2sim.own_maps.map_file import MapFile
from real2sim.own_maps.network_writer import read_offset, write_network_folder
from real2sim.own_maps.osm_buildings import find_buildings
from real2sim.own_maps.osm_compile import IMPORT_OPTIONS, apply_right_of_way, compile_osm
from real2sim.own_maps.osm_losses import CAR_ROADS, list_losses
from real2sim.own_maps.osm_signs import (
    build_stop_boxes,
    build_yield_signs,
    derive_right_of_way,
    find_signs,
    place_signs,
)
from real2sim.readers.osm_file import import_pyproj, parse_osm
from real2sim.xml_file import Element, read_number

MAX_EXTENT_DEG = 1.0
"""[degrees] Between nodes of roads: 110 km from north to south. Extracts with whole ways reach out of their part."""
LICENCE = "Open Database Licence 1.0 (ODbL), (c) OpenStreetMap contributors"


def convert_osm(source: MapFile, folder: Path, name: str, left_hand: bool) -> tuple[RoadMap, tuple[str, ...]]:
    """Write the folder of an extract's network; return its road map and what could not be kept. Raises InputError."""
    _check_roads(source)
    left_hand = left_hand or _drives_left(source.root)
    net = compile_osm(source.path, source.data, left_hand)
    if next(net.iter("lane"), None) is None:
        raise InputError(f"{source.path}: expected roads that cars may use, found none after netconvert's import")
    offset = read_offset(source.path, net)
    about = NetworkFile(
        name=name,
        description=f"made from the OpenStreetMap extract {source.path.name}",
        origin=f"OpenStreetMap, extract {source.path.name}",
        licence=LICENCE,
        offset=offset,
        build=("netconvert", "--osm-files", source.path.name, *IMPORT_OPTIONS, *(("--lefthand",) if left_hand else ())),
        checksum="",
    )
    roads = write_network_folder(source.path, folder, net, about)
    osm = parse_osm(source.path, source.root, lambda degrees: _project(source.path, net, degrees) + offset)
    approaches = place_signs(find_signs(osm, source.root), roads)
    net = apply_right_of_way(source.path, net, *derive_right_of_way(approaches, net), left_hand)
    roads = write_network_folder(source.path, folder, net, about)
    buildings = find_buildings(osm, roads)
    added = {
        "buildings": buildings.kept,
        "stop_signs": build_stop_boxes(approaches, roads),
        "yield_signs": build_yield_signs(approaches, roads),
    }
    roads = write_network_folder(source.path, folder, net, about.model_copy(update=added))
    return roads, tuple(list_losses(source.root, osm, buildings, approaches, left_hand))


def _check_roads(source: MapFile) -> None:
    """Raise InputError for an extract without roads, or one that is too large, before netconvert reads it."""
    ways = [way for way in source.root.iter("way") if _get_tags(way).get("highway") in CAR_ROADS]
    if not ways:
        raise InputError(
            f"{source.path}: expected roads (ways with highway=residential, primary, ...), found none among"
            f" {sum(1 for _ in source.root.iter('way'))} ways{_suggest_lanelet2(source.root)}"
        )
    used = {nd.get("ref") for way in ways for nd in way.iter("nd")}
    degrees = np.array(
        [
            [read_number(source.path, node, axis) for axis in ("lon", "lat")]
            for node in source.root.iter("node")
            if node.get("id") in used
        ]
    )
    if not len(degrees):
        raise InputError(f"{source.path}: expected the nodes of its roads, found none")
    if (np.abs(degrees) > (180.0, 90.0)).any():
        raise InputError(f"{source.path}: expected latitudes within 90 and longitudes within 180 degrees, found others")
    extent = float((degrees.max(0) - degrees.min(0)).max())
    if extent > MAX_EXTENT_DEG:
        raise InputError(
            f"{source.path}: expected roads within {MAX_EXTENT_DEG:g} degree of each other, found {extent:.2f}; cut a"
            " smaller part out, such as 500 m around a junction"
        )


def _suggest_lanelet2(root: Element) -> str:
    """Say where maps of lanelets are read, which have the same form."""
    is_lanelet2 = any(tag.get("v") == "lanelet" for tag in root.iter("tag"))
    return "; this is a Lanelet2 map, which the sources `interaction` and `levelx` read" if is_lanelet2 else ""


def _get_tags(element: Element) -> dict[str, str]:
    return {tag.get("k", ""): tag.get("v", "") for tag in element.iter("tag")}


def _drives_left(root: Element) -> bool:
    """Return whether a road of the extract says that traffic keeps left, as few do."""
    return any(tag.get("k") == "driving_side" and tag.get("v") == "left" for tag in root.iter("tag"))


def _project(path: Path, net: Element, degrees: Float) -> Float:
    """Project longitudes and latitudes (N, 2) as netconvert has: (N, 2) [m] without the net's offset."""
    location = net.find("location")
    text = "" if location is None else location.get("projParameter", "")
    projection: Any = import_pyproj(path).Proj(text)
    return np.column_stack(projection(*degrees.T))
