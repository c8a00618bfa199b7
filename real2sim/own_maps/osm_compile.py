"""Compile an OpenStreetMap extract with netconvert, with the right of way of its signs."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from xml.etree import ElementTree

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.installation_command import format_installation
from mdrive_sumo.core.output_files import write_bytes, write_text
from mdrive_sumo.roads.netconvert import find_netconvert, run_netconvert
from real2sim.xml_file import Element

TYPE_MAP = "osmNetconvert.typ.xml"
"""SUMO's lanes, speeds and priorities by class of road."""
JUNCTION_OPTIONS = (
    "--junctions.internal-link-detail",
    "20",
    "--junctions.corner-detail",
    "6",
    "--default.junctions.radius",  # with SUMO's 4 m, right turns are kinks that no car drives
    "7",
    "--precision",
    "3",
)
IMPORT_OPTIONS = (
    "--proj.utm",
    "--geometry.remove",  # nodes of one road only are no junctions
    "--ramps.guess",
    "--junctions.join",  # a crossing of dual carriageways is one junction
    "--tls.guess-signals",  # signals stand before the crossing
    "--tls.discard-simple",
    "--tls.join",
    "--osm.sidewalks",
    "--osm.crossings",
    "--osm.turn-lanes",
    "--osm.lane-access",
    "--output.street-names",
    "--keep-edges.by-vclass",
    "passenger,pedestrian",
    "--remove-edges.isolated",
    "--no-turnarounds",  # traffic leaves where the extract ends
)
"""Those that SUMO's documentation recommends for OpenStreetMap, with footways for pictures."""


def compile_osm(source: Path, data: bytes, left_hand: bool) -> Element:
    """Return the net of an extract. Raises InputError if netconvert is missing or refuses it."""
    options = (*IMPORT_OPTIONS, *JUNCTION_OPTIONS, *(("--lefthand",) if left_hand else ()))
    with tempfile.TemporaryDirectory() as scratch:
        write_bytes(Path(scratch) / "map.osm", data)
        arguments = ("--osm-files", "map.osm", "--type-files", str(_find_type_map()), *options)
        return _parse(run_netconvert(arguments, Path(scratch), f"{source}: expected a map"))


def apply_right_of_way(
    source: Path, net: Element, priority: Mapping[str, int], types: Mapping[str, str], left_hand: bool
) -> Element:
    """Compile a net anew with other priorities by edge and types by node, so that signs give the right of way."""
    if not priority and not types:
        return net
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        write_bytes(folder / "map.net.xml", ElementTree.tostring(net, encoding="utf-8"))
        write_text(folder / "signs.edg.xml", _build_patch("edges", "edge", "priority", priority))
        write_text(folder / "signs.nod.xml", _build_patch("nodes", "node", "type", types))
        arguments = (
            "--sumo-net-file", "map.net.xml", "--edge-files", "signs.edg.xml", "--node-files", "signs.nod.xml",
            "--offset.disable-normalization", "--output.street-names", "--no-turnarounds",
            *JUNCTION_OPTIONS, *(("--lefthand",) if left_hand else ()),
        )  # fmt: skip
        return _parse(run_netconvert(arguments, folder, f"{source}: expected signs"))


def _build_patch(root: str, tag: str, attribute: str, values: Mapping[str, object]) -> str:
    patch = ElementTree.Element(root)
    for name, value in values.items():
        ElementTree.SubElement(patch, tag, {"id": name, attribute: str(value)})
    return ElementTree.tostring(patch, encoding="unicode")


def _parse(net: bytes) -> Element:
    return ElementTree.fromstring(net)  # without comments, which hold date and paths


def _find_type_map() -> Path:
    """Return the path of SUMO's table of road classes. Raises InputError."""
    program = find_netconvert()
    places = (program.parent.parent / "data" / "typemap", Path("/usr/share/sumo/data/typemap"))
    found = next((place / TYPE_MAP for place in places if (place / TYPE_MAP).is_file()), None)
    if found is None:
        remedy = format_installation("convert")
        raise InputError(f"{program}: expected SUMO's {TYPE_MAP} beside it, found none ({remedy})")
    return found
