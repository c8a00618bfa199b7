"""Build network folders from OpenDRIVE through netconvert, or those of CARLA towns from an existing SUMO net."""

import gzip
import hashlib
import math
import re
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.output_files import make_folder, write_bytes, write_text
from mdrive_sumo.roads import NetworkFile, load_road_map
from mdrive_sumo.roads.netconvert import OUT_OF_MEMORY, run_netconvert
from mdrive_sumo.roads.network_file import NET_FILE, NETWORK_FILE, compute_net_checksum
from real2sim.carla.left_hand_map import mirror_net
from real2sim.carla.opendrive import OpenDriveMap, measure_lane_gaps, place_stop_signs, read_opendrive
from real2sim.xml_file import Element, read_xml

OFFSET_TOLERANCE_M = 0.01
"""spec/sumo_pitfalls 8.1: the round trip of the offset must be below 1 cm."""
CARLA_LICENCE = "not stated in the file; the CARLA project publishes its towns under the MIT licence"
UNKNOWN_LICENCE = "unknown"
CARLA_TOWN = re.compile(r"Town[0-9]{2}(HD)?(_Opt)?")
"""Names of the towns that CARLA comes with; other maps of scenarios are their authors'."""
RESOLUTIONS_M = (1.0, 2.0)
"""[m] Steps of curves: the finer one, and netconvert's own for maps that need too much memory with that."""
OPENDRIVE_OPTIONS = (
    "--junctions.internal-link-detail",  # 5 points make a turn of 22-degree kinks
    "20",
    "--no-turnarounds.except-deadend",
    "--precision",  # of 3 digits the offset too is exact to the millimetre
    "3",
)
"""Without `--opendrive.internal-shapes`: it folds lanes in junctions (heading change 114 instead of 67 deg)."""


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
    left_hand: bool = False
    measured_lanes: int = 0
    """Innermost lanes of roads with a simple cross-section, which are compared with the map."""
    displaced_lanes: int = 0
    """Those of them that lie over 0.5 m beside the map's."""


@dataclass(frozen=True, slots=True)
class NetworkOrigin:
    """What `network.json` says about where a network comes from."""

    description: str
    licence: str


def build_town_network(name: str, maps: Path, folder: Path) -> TownNetwork:
    """Build the network folder of a town whose maps are in `maps`; raise InputError.

    The `.xodr` file is preferred because it contains the signs. A file without any `<signal>` (the builds of 2019) is
    replaced by an existing net, which is newer and has the traffic lights.
    """
    xodr, net = maps / f"{name}.xodr", maps / f"{name}.net.xml"
    if not xodr.is_file() and not net.is_file():
        raise InputError(f"{maps}: expected {xodr.name} or {net.name}, found neither")
    drive = read_opendrive(xodr) if xodr.is_file() else None
    about = _describe_town(name)
    if drive is None or (drive.stop_signs is None and net.is_file()):
        return _build_from_net(name, net, folder, about)
    town = _build_from_opendrive(name, xodr, drive, folder, about)
    if town.offset_error_m >= OFFSET_TOLERANCE_M:
        raise InputError(
            f"{xodr}: expected lanes of the net within {OFFSET_TOLERANCE_M} m, found {town.offset_error_m:.3f} m"
        )
    return town


def _describe_town(name: str) -> NetworkOrigin:
    if CARLA_TOWN.fullmatch(name):
        return NetworkOrigin(f"CARLA {name}; y flipped, angles negated against CARLA", CARLA_LICENCE)
    return NetworkOrigin(f"town {name} of a scenario; y flipped, angles negated against CARLA", UNKNOWN_LICENCE)


def build_opendrive_network(xodr: Path, folder: Path, name: str = "") -> TownNetwork:
    """Build the network folder of any OpenDRIVE map, by default named after its file; raise InputError.

    The offset is that of netconvert; its error is only reported, because a map whose lanes change their widths may
    differ from its network by more than a town's.
    """
    drive = read_opendrive(xodr)
    side = "; left-hand: compiled as its mirror image, which was mirrored back" if drive.left_hand else ""
    about = NetworkOrigin(f"made from the OpenDRIVE map {xodr.name}{side}", UNKNOWN_LICENCE)
    return _build_from_opendrive(name or make_network_name(xodr), xodr, drive, folder, about)


def make_network_name(xodr: Path) -> str:
    """Return the name of a map's network: that of its file in the characters of an identifier."""
    return re.sub(r"[^A-Za-z0-9_.+-]", "_", xodr.stem).lstrip("_.+-")[:80] or "map"


def _build_from_net(name: str, net: Path, folder: Path, origin: NetworkOrigin) -> TownNetwork:
    source = f"ready net {net.name}, {_hash_file(net)}"
    xml = read_xml(net)
    about = _build_network_file(name, xml, source, (), origin)
    _write_network(folder, xml, about)
    return TownNetwork(name, folder, about.offset, source, None, (), math.nan)


def _build_from_opendrive(
    name: str, xodr: Path, drive: OpenDriveMap, folder: Path, origin: NetworkOrigin
) -> TownNetwork:
    source = f"{xodr.name} of {drive.date or 'unknown date'}, {_hash_file(xodr)}"
    compiled, resolution_m = _compile(xodr, drive)
    xml = ElementTree.fromstring(compiled)
    command = build_opendrive_command(xodr.name, "map.net.xml", resolution_m)
    about = _build_network_file(name, xml, source, command, origin)
    with tempfile.TemporaryDirectory() as draft:  # the signs need the lanes, network.json needs the signs
        _write_network(Path(draft), xml, about)
        roads = load_road_map(Path(draft))
    gaps = measure_lane_gaps(drive.lane_middles, roads, about.offset)
    placed = place_stop_signs(drive.stop_signs or (), roads, about.offset)
    signs = None if drive.stop_signs is None else placed.boxes
    if drive.left_hand:
        mirror_net(xml)
        about = _build_network_file(name, xml, source, command, origin)
    _write_network(folder, xml, about.model_copy(update={"stop_signs": signs}))
    sign_count = None if signs is None else len(signs)
    coarse = f"curves in steps of {resolution_m:g} m: with {RESOLUTIONS_M[0]:g} m netconvert runs out of memory"
    repairs = drive.repairs + ((coarse,) if resolution_m != RESOLUTIONS_M[0] else ())
    return TownNetwork(
        name, folder, about.offset, source, sign_count, placed.unplaced, gaps.median_m, repairs, drive.left_hand,
        gaps.measured, gaps.displaced,
    )  # fmt: skip


def _compile(xodr: Path, drive: OpenDriveMap) -> tuple[bytes, float]:
    """Compile the map as it is read; return the net and the step of its curves [m]."""
    if not drive.is_changed:
        return compile_opendrive(xodr)
    with tempfile.TemporaryDirectory() as folder:
        changed = Path(folder) / f"{make_network_name(xodr)}.xodr"
        write_bytes(changed, _serialise(drive.root))
        return compile_opendrive(changed, xodr)


def _build_network_file(
    name: str, xml: Element, source: str, build: Sequence[str], origin: NetworkOrigin
) -> NetworkFile:
    return NetworkFile(
        name=name,
        description=origin.description,
        origin=source,
        licence=origin.licence,
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


def _list_options(resolution_m: float) -> tuple[str, ...]:
    return ("--opendrive.curve-resolution", f"{resolution_m:.1f}", *OPENDRIVE_OPTIONS)


def build_opendrive_command(xodr: str, net: str, resolution_m: float = RESOLUTIONS_M[0]) -> tuple[str, ...]:
    """Return the netconvert command that compiles an OpenDRIVE file to a net file."""
    return ("netconvert", "--opendrive-files", xodr, "--output-file", net, *_list_options(resolution_m))


def compile_opendrive(xodr: Path, named: Path | None = None) -> tuple[bytes, float]:
    """Compile an OpenDRIVE map; return the SUMO net and the step of its curves [m].

    `named` is the file that errors name, if `xodr` is a repaired copy. Raises InputError if netconvert is missing or
    rejects the map.
    """
    expected = f"{named or xodr}: expected a map"
    for resolution_m in RESOLUTIONS_M:
        arguments = ("--opendrive-files", str(xodr.resolve()), *_list_options(resolution_m))
        try:
            return run_netconvert(arguments, xodr.parent, expected), resolution_m
        except InputError as error:
            if OUT_OF_MEMORY not in str(error) or resolution_m == RESOLUTIONS_M[-1]:
                raise
    raise AssertionError("one of the resolutions returns or raises")
