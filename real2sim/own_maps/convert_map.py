"""Convert a map of the user's own to a network's folder, with a report of what could not be kept."""

import re
import tempfile
from dataclasses import dataclass
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_bytes, write_text
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.scenario.scenario_part import Identifier
from real2sim.carla.town_network import TownNetwork, build_opendrive_network
from real2sim.own_maps.drivability import Drivability, check_drivability
from real2sim.own_maps.map_file import MapFile, MapKind, read_map_file
from real2sim.own_maps.osm_map import convert_osm
from real2sim.own_maps.sumo_net import convert_sumo_net

REPORT_FILE = "conversion.md"
ENDINGS = re.compile(r"(\.(net\.xml|osm\.xml|osm|xodr|xml))?(\.gz)?$", re.IGNORECASE)


@dataclass(frozen=True)
class ConvertedMap:
    """A network's folder, and what was found on the way."""

    name: str
    folder: Path
    kind: MapKind
    lost: tuple[str, ...]
    """What could not be kept of the map, one sentence each."""
    drivability: Drivability
    buildings: int
    stop_signs: int | None
    """None: unknown."""
    signals: int
    """Traffic lights."""


def convert_map(path: Path, out: Path, name: str | None = None, left_hand: bool = False) -> ConvertedMap:
    """Convert a SUMO net, an OpenDRIVE map or an OpenStreetMap extract to the folder `out`, which is new or empty.

    name: of the network; None for that of the file. left_hand: traffic of an OpenStreetMap extract keeps left; the
    other maps say it themselves. The folder appears only if the whole conversion succeeds. Raises InputError.
    """
    name = _check_name(name or _make_name(path))
    source = read_map_file(path)
    if left_hand and source.kind is not MapKind.OPENSTREETMAP:
        raise InputError(f"{path}: --left-hand: expected an OpenStreetMap extract; a {source.kind} says it itself")
    with atomic_folder(out) as draft:
        roads, lost = _convert(source, draft, name, left_hand)
        drivability = check_drivability(str(path), roads)
        lights = {light.partition(":")[0] for lane in roads.driving for light in lane.lights.values()}
        signs = None if roads.stop_signs is None else len(roads.stop_signs)
        found = ConvertedMap(name, out, source.kind, lost, drivability, len(roads.buildings), signs, len(lights))
        write_text(draft / REPORT_FILE, format_report(found, path.name))
    return found


def _make_name(path: Path) -> str:
    """Return the name of a map's network: that of its file in the characters of an identifier."""
    return re.sub(r"[^A-Za-z0-9_.+-]", "_", ENDINGS.sub("", path.name)).lstrip("_.+-")[:80] or "map"


def _check_name(name: str) -> str:
    try:
        return TypeAdapter(Identifier).validate_python(name)
    except ValidationError:
        raise InputError(f"--name: expected up to 80 letters, digits and _.+-, found {name!r:.90}") from None


def _convert(source: MapFile, folder: Path, name: str, left_hand: bool) -> tuple[RoadMap, tuple[str, ...]]:
    match source.kind:
        case MapKind.SUMO:
            return convert_sumo_net(source, folder, name)
        case MapKind.OPENSTREETMAP:
            return convert_osm(source, folder, name, left_hand)
        case MapKind.OPENDRIVE:
            town = _build_opendrive(source, folder, name)
            load_road_map.cache_clear()  # the folder may have held the same network without its signs
            return load_road_map(folder), tuple(_list_opendrive_losses(source, town))


def _build_opendrive(source: MapFile, folder: Path, name: str) -> TownNetwork:
    """Build a network of an OpenDRIVE map, which netconvert reads from a file that is not packed."""
    if source.path.suffix != ".gz":
        return build_opendrive_network(source.path, folder, name)
    with tempfile.TemporaryDirectory() as scratch:
        unpacked = Path(scratch) / source.path.stem
        write_bytes(unpacked, source.data)
        return build_opendrive_network(unpacked, folder, name)


def _list_opendrive_losses(source: MapFile, town: TownNetwork) -> list[str]:
    losses = list(town.repairs)
    if town.displaced_lanes:
        losses.append(
            f"accuracy: {town.displaced_lanes} of {town.measured_lanes} lanes that can be compared lie over 0.5 m"
            " beside those of the map"
        )
    if town.unplaced_signs:
        losses.append(f"signs: {len(town.unplaced_signs)} stop signs left out, without a lane")
    if town.stop_signs is None:
        losses.append("signs: the map has no signals, so its stop signs are unknown")
    if objects := sum(1 for _ in source.root.iter("object")):
        losses.append(f"objects: {objects} (buildings, trees, poles) left out; network.json can name buildings")
    if source.root.find(".//elevation") is not None:
        losses.append("heights: all is driven and seen in one plane")
    return losses


def format_report(found: ConvertedMap, source: str) -> str:
    """Return the report as Markdown."""
    facts = found.drivability
    lines = [
        f"# Network {found.name}",
        "",
        f"Made from the {found.kind} `{source}`: {facts.lanes} lanes of {facts.metres:.0f} m for cars,"
        f" {facts.junctions} junctions, {found.signals} traffic lights, {found.buildings} buildings,"
        f" {'unknown' if found.stop_signs is None else found.stop_signs} stop signs.",
        "",
        "## Not kept",
        "",
        *(f"- {line}" for line in found.lost or ("nothing",)),
        "",
        "## Checks",
        "",
        *(f"- {line}" for line in facts.findings or ("all passed",)),
        "",
    ]
    return "\n".join(lines)
