"""A SUMO net of the user's own: moved near the origin if need be, and otherwise kept as it is."""

from collections import Counter
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import NetworkFile, RoadMap
from real2sim.own_maps.map_file import MapFile
from real2sim.own_maps.network_writer import read_offset, write_network_folder
from real2sim.xml_file import Element, parse_finite

FAR_M = 900_000.0
"""[m] Networks beyond are moved: scenario files hold coordinates within 1 000 km."""
MAX_EXTENT_M = 200_000.0
"""[m] Width and height of a network: no scenario drives so far, and a wrong point shows itself."""
KILOMETRE = 1000.0


def convert_sumo_net(source: MapFile, folder: Path, name: str) -> tuple[RoadMap, tuple[str, ...]]:
    """Write the folder of a net; return its road map and what could not be kept. Raises InputError."""
    net = source.root
    origin = _find_origin(source.path, net)
    if any(origin):
        _move(net, origin)
    about = NetworkFile(
        name=name,
        description=f"made from the SUMO net {source.path.name}",
        origin=f"own net {source.path.name}",
        licence="that of the net",
        offset=read_offset(source.path, net),
        log_origin=origin if any(origin) else None,
        build=(),
        checksum="",
    )
    roads = write_network_folder(source.path, folder, net, about)
    return roads, tuple(_list_losses(net, origin))


def _find_origin(path: Path, net: Element) -> tuple[float, float]:
    """Return by how much to move a net [m]: whole kilometres, (0, 0) if it lies near the origin. Raises InputError."""
    points = [_parse_point(path, text) for lane in net.iter("lane") for text in lane.get("shape", "").split()]
    if not points:
        raise InputError(f"{path}: expected lanes with shapes, found none")
    low, high = (tuple(pick(axis) for axis in zip(*points, strict=True)) for pick in (min, max))
    extent = max(high[0] - low[0], high[1] - low[1])
    if extent > MAX_EXTENT_M:
        found = f"found {extent / KILOMETRE:.0f} km"
        raise InputError(f"{path}: expected lanes within {MAX_EXTENT_M / KILOMETRE:g} km of each other, {found}")
    if max(map(abs, (*low, *high))) <= FAR_M:
        return 0.0, 0.0
    return low[0] // KILOMETRE * KILOMETRE, low[1] // KILOMETRE * KILOMETRE


def _parse_point(path: Path, text: str) -> tuple[float, float]:
    x, _, rest = text.partition(",")
    where = f"{path}: shape of a lane"
    return parse_finite(where, x), parse_finite(where, rest.partition(",")[0])


def _move(net: Element, origin: tuple[float, float]) -> None:
    """Subtract an origin [m] from all points of a net, in place."""
    for element in net.iter():
        for name in ("shape", "customShape"):
            if "," in element.get(name, ""):
                element.set(name, " ".join(_move_point(point, origin) for point in element.get(name, "").split()))
        if element.tag == "junction":
            for axis, name in enumerate("xy"):
                element.set(name, f"{parse_finite('junction', element.get(name)) - origin[axis]:.3f}")
    if (location := net.find("location")) is not None:
        x, y = (float(part) for part in location.get("netOffset", "0,0").split(","))
        location.set("netOffset", f"{x - origin[0]:.3f},{y - origin[1]:.3f}")
        numbers = [float(part) for part in location.get("convBoundary", "0,0,0,0").split(",")]
        moved = [number - origin[axis % 2] for axis, number in enumerate(numbers)]
        location.set("convBoundary", ",".join(f"{number:.3f}" for number in moved))


def _move_point(point: str, origin: tuple[float, float]) -> str:
    x, y, *z = point.split(",")
    return ",".join((f"{float(x) - origin[0]:.3f}", f"{float(y) - origin[1]:.3f}", *z))


def _list_losses(net: Element, origin: tuple[float, float]) -> list[str]:
    losses: list[str] = []
    if any(origin):
        losses.append(f"coordinates: moved by ({-origin[0]:.0f}, {-origin[1]:.0f}) m; exports move them back")
    lanes = [lane for edge in net.iter("edge") if edge.get("function") != "internal" for lane in edge.iter("lane")]
    heights = sum(text.count(",") > 1 for lane in lanes for text in lane.get("shape", "").split()[:1])
    if heights:
        losses.append(f"heights: {heights} lanes have them, all is driven and seen in one plane")
    functions = Counter(edge.get("function", "") for edge in net.iter("edge"))
    if not functions["internal"]:
        losses.append(
            "lanes inside junctions: the net has none, so routes cross junctions in straight lines;"
            " netconvert makes them without `--no-internal-links`"
        )
    losses.append(
        "buildings and signs are not part of a SUMO net: network.json can name them; additional files (stops,"
        " detectors, polygons) are not read"
    )
    return losses
