"""Build network folders of CARLA towns from OpenDRIVE through netconvert, or from an existing SUMO net."""

import gzip
import hashlib
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_folder, write_bytes, write_text
from mdrive_sumo.roads import NetworkFile, RoadMap, load_road_map
from mdrive_sumo.roads.network_file import NET_FILE, NETWORK_FILE, compute_net_checksum
from real2sim.carla.opendrive import OpenDriveMap, measure_offset_error, place_stop_signs, read_opendrive
from real2sim.carla.road_links import repair_road_links
from real2sim.netconvert import build_opendrive_command, compile_opendrive
from real2sim.xml_file import Element, read_xml

OFFSET_TOLERANCE_M = 0.01
"""spec/sumo_pitfalls 8.1: the round trip of the offset must be below 1 cm."""
LICENCE = "not stated in the file; the CARLA project publishes its towns under the MIT licence"


@dataclass(frozen=True, slots=True)
class TownNetwork:
    """A converted town with its figures for the conversion report."""

    name: str
    folder: Path
    offset: tuple[float, float]
    """SUMO x = x_carla + offset x, SUMO y = -y_carla + offset y [m]."""
    source: str
    stop_signs: int | None
    """Number of stop boxes; None: unknown."""
    unplaced_signs: tuple[str, ...]
    offset_error_m: float
    """NaN: not measurable (existing nets)."""
    repairs: tuple[str, ...] = ()
    """Repairs of the map before compilation."""


def build_town_network(name: str, maps: Path, folder: Path) -> TownNetwork:
    """Build the network folder of a town whose maps are in `maps`; raise InputError.

    The `.xodr` file is preferred because it contains the signs. A file without any `<signal>` (the builds of 2019) is
    replaced by an existing net, which is newer and has the traffic lights.
    """
    xodr, net = maps / f"{name}.xodr", maps / f"{name}.net.xml"
    if not xodr.is_file() and not net.is_file():
        raise InputError(f"{maps}: expected {xodr.name} or {net.name}, found neither")
    drive = read_opendrive(xodr) if xodr.is_file() else None
    if drive is None or (drive.stop_signs is None and net.is_file()):
        return _build_from_net(name, net, folder)
    return _build_from_opendrive(name, xodr, drive, folder)


def build_opendrive_network(xodr: Path, folder: Path) -> TownNetwork:
    """Build the network folder of an OpenDRIVE map, named after its file; raise InputError."""
    return _build_from_opendrive(xodr.stem, xodr, read_opendrive(xodr), folder)


def _build_from_net(name: str, net: Path, folder: Path) -> TownNetwork:
    source = f"ready net {net.name}, {_hash_file(net)}"
    xml = read_xml(net)
    about = _build_network_file(name, xml, source, ())
    _write_network(folder, xml, about)
    return TownNetwork(name, folder, about.offset, source, None, (), math.nan)


def _build_from_opendrive(name: str, xodr: Path, drive: OpenDriveMap, folder: Path) -> TownNetwork:
    source = f"{xodr.name} of {drive.date or 'unknown date'}, {_hash_file(xodr)}"
    compiled, repairs = _compile_repaired(xodr)
    xml = ElementTree.fromstring(compiled)
    about = _build_network_file(name, xml, source, build_opendrive_command(xodr.name, "map.net.xml"))
    with tempfile.TemporaryDirectory() as draft:  # the signs need the lanes, network.json needs the signs
        _write_network(Path(draft), xml, about)
        roads = load_road_map(Path(draft))
    error = _check_offset(xodr, drive, roads, about.offset)
    placed = place_stop_signs(drive.stop_signs or (), roads, about.offset)
    signs = None if drive.stop_signs is None else placed.boxes
    _write_network(folder, xml, about.model_copy(update={"stop_signs": signs}))
    known = None if signs is None else len(signs)
    return TownNetwork(name, folder, about.offset, source, known, placed.unplaced, error, repairs)


def _compile_repaired(xodr: Path) -> tuple[bytes, tuple[str, ...]]:
    """Compile the map; return the net and the repairs that were necessary."""
    root = read_xml(xodr)
    repairs = repair_road_links(root)
    if not repairs:
        return compile_opendrive(xodr), ()
    with tempfile.TemporaryDirectory() as folder:
        repaired = Path(folder) / xodr.name
        write_bytes(repaired, _serialise(root))
        return compile_opendrive(repaired), repairs


def _check_offset(xodr: Path, drive: OpenDriveMap, roads: RoadMap, offset: tuple[float, float]) -> float:
    error = measure_offset_error(drive.road_middles, roads, offset)
    if error >= OFFSET_TOLERANCE_M:
        raise InputError(f"{xodr}: expected lane borders of the net within {OFFSET_TOLERANCE_M} m, found {error:.3f} m")
    return error


def _build_network_file(name: str, xml: Element, source: str, build: Sequence[str]) -> NetworkFile:
    return NetworkFile(
        name=name,
        description=f"CARLA {name}; y flipped, angles negated against CARLA",
        origin=source,
        licence=LICENCE,
        offset=_read_offset(name, xml),
        build=tuple(build),
        checksum=compute_net_checksum(_serialise(xml)),
    )


def _read_offset(name: str, xml: Element) -> tuple[float, float]:
    location = xml.find("location")
    text = "" if location is None else location.get("netOffset", "")
    try:
        x, y = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f'net of {name}: expected <location netOffset="x,y">, found {text!r}') from None
    return x, y


def _write_network(folder: Path, xml: Element, about: NetworkFile) -> None:
    make_folder(folder)
    write_bytes(folder / NET_FILE, gzip.compress(_serialise(xml), mtime=0))
    write_text(folder / NETWORK_FILE, about.model_dump_json(indent=2) + "\n")


def _serialise(xml: Element) -> bytes:
    """Serialise without comments, which contain date and paths: the same map gives the same bytes."""
    return ElementTree.tostring(xml, encoding="utf-8", xml_declaration=True)


def _hash_file(path: Path) -> str:
    return "sha256:" + hashlib.sha256(read_bytes(path)).hexdigest()
