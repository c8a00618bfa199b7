"""RoadMap: a SUMO network as lanes in the world frame, with buildings and signs. sumolib's conventions end here."""

# pyright: basic
import gzip
import re
import sys
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from importlib.resources import files
from itertools import chain
from pathlib import Path
from types import ModuleType
from typing import Any
from xml.sax import SAXException

import numpy as np
import shapely

from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Bool, Float, Int, Polyline, build_polyline
from mdrive_sumo.core.input_files import open_regular
from mdrive_sumo.roads.junction_controls import find_junction_controls, find_roundabout_edges
from mdrive_sumo.roads.lane_search import LineSegments, build_line_segments, find_nearest_lines
from mdrive_sumo.roads.network_file import (
    NET_FILE,
    Building,
    BusStop,
    DrivableArea,
    NetworkFile,
    ParkingRow,
    StopSignBox,
    YieldSign,
    compute_net_checksum,
    read_network_file,
)

CROSSWALK_EDGE = re.compile(r"ecrosswalk_\d+")
"""Ids of the unconnected footways by which `convert` draws the crosswalks of a log's map."""
MAX_NET_BYTES = 256 * 2**20
"""Bytes of an uncompressed net; a map of CARLA's Town04 has 0.7 MB."""
_NET_ERRORS = (
    SAXException, SyntaxError, LookupError, ValueError, TypeError, AttributeError, AssertionError, ArithmeticError,
    shapely.errors.ShapelyError,
)  # fmt: skip
"""What sumolib raises for nets that lack parts; SyntaxError is that of lxml, which it uses if there is one."""


@dataclass(frozen=True)
class Lane:
    """A lane that cars may use. `centre` runs in driving direction."""

    id: str
    edge: str
    index: int
    """0 is the lane beside the kerb: the rightmost of the edge, the leftmost in networks that keep to the left."""
    width: float
    speed_limit: float
    centre: Polyline
    junction: bool
    """Whether the lane lies inside a junction (a SUMO internal lane)."""
    successors: tuple[str, ...]
    """Ids of the lanes reached at the end; from a road these are junction lanes where there are any."""
    left: str
    """Id of the neighbour to the left in the same direction, or ""."""
    right: str
    lights: Mapping[str, str]
    """Successor id -> "tls:index" of the traffic light that controls the way there."""


@dataclass(frozen=True)
class Footway:
    """A pavement along an edge: centre line and width [m]. People walk it both ways."""

    edge: str
    centre: Polyline
    width: float


@dataclass(frozen=True)
class NearestLanes:
    """The nearest lane of each of M points; all arrays (M,)."""

    lane: Int
    """Index into `RoadMap.driving`."""
    distance: Float
    """To the centre line [m]."""
    yaw: Float
    """Direction of the lane there [rad]."""


@dataclass(frozen=True, eq=False)
class RoadMap:
    """A network: lanes by id, buildings and other areas, and its folder."""

    name: str
    folder: Path
    lanes: Mapping[str, Lane]
    junctions: tuple[Float, ...]
    """Outlines (K, 2) [m] of the junction areas, for pictures."""
    pavements: tuple[Float, ...]
    """Outlines (K, 2) [m] of what pedestrians walk on beside the road, for pictures."""
    crossings: tuple[tuple[Float, float], ...]
    """Centre lines (K, 2) [m] and widths [m] of pedestrian crossings, for pictures."""
    buildings: tuple[Building, ...]
    stop_signs: tuple[StopSignBox, ...] | None
    checksum: str
    crosswalk_pavements: tuple[int, ...] = ()
    """Indices into `pavements` of the crosswalks of a converted log, for pictures."""
    drivable_areas: tuple[DrivableArea, ...] = ()
    """Asphalt beyond the lanes, for pictures."""
    log_origin: tuple[float, float] = (0.0, 0.0)
    """Origin of a converted log that was shifted, in the frame of the log [m]."""
    junction_controls: Mapping[str, JunctionKind] = field(default_factory=dict[str, JunctionKind])
    """What controls the way into a junction, by id of the first lane inside it; see `find_junction_controls`."""
    roundabout_edges: frozenset[str] = frozenset()
    """Ids of the edges of roundabouts."""
    parking: tuple[ParkingRow, ...] = ()
    """Where parked vehicles may stand."""
    bus_stops: tuple[BusStop, ...] = ()
    footways: tuple[Footway, ...] = ()
    """Sorted by edge; `pavements` has their outlines, and those of the corners between them."""
    cycle_lanes: Mapping[str, Lane] = field(default_factory=dict[str, Lane])
    """Lanes that bicycles may use and cars may not, by id; their neighbours are among each other."""
    yield_signs: tuple[YieldSign, ...] = ()

    @property
    def net_file(self) -> Path:
        """The compiled net, as SUMO reads it."""
        return self.folder / NET_FILE

    @cached_property
    def driving(self) -> tuple[Lane, ...]:
        """All lanes, in the order that `NearestLanes.lane` indexes."""
        return tuple(self.lanes.values())

    @cached_property
    def lane_width(self) -> Float:
        """Width (L,) [m] of every lane of `driving`."""
        return np.array([lane.width for lane in self.driving])

    @cached_property
    def in_junction(self) -> Bool:
        """Whether each lane (L,) of `driving` lies in a junction."""
        return np.array([lane.junction for lane in self.driving], dtype=np.bool_)

    @cached_property
    def legal_speed(self) -> Float:
        """Speed limit (L,) [m/s] of every lane of `driving` as a driver sees it.

        In a junction it is that of the fastest road that the lane comes from or leads to: netconvert gives junction
        lanes the speed at which a car takes their curve, which no sign says.
        """
        legal = {lane.id: lane.speed_limit for lane in self.driving}
        links = [(lane, self.lanes[after]) for lane in self.driving for after in lane.successors]
        inside = [pair for pair in links if pair[0].junction or pair[1].junction]
        known: dict[str, float] = {}
        while legal != known:  # a way through a junction may consist of several lanes
            known = dict(legal)
            for before, after in inside:
                if after.junction:
                    legal[after.id] = max(legal[after.id], legal[before.id])
                if before.junction:
                    legal[before.id] = max(legal[before.id], legal[after.id])
        return np.array(list(legal.values()))

    def find_lanes_under(self, xy: Float) -> tuple[Int, Int]:
        """Return which lanes cover which points xy (M, 2) [m]: indices of points and into `driving`, both (K,).

        A lane covers what is at most half its width from its centre line, also beyond its ends.
        """
        points = np.asarray(shapely.points(xy))
        point, lane = self._tree.query(points, predicate="dwithin", distance=float(self.lane_width.max()) / 2)
        covers = shapely.distance(np.asarray(self._tree.geometries)[lane], points[point]) <= self.lane_width[lane] / 2
        return point[covers], lane[covers]

    @cached_property
    def _tree(self) -> shapely.STRtree:
        return shapely.STRtree([shapely.LineString(lane.centre.xy) for lane in self.driving])

    @cached_property
    def _segments(self) -> LineSegments:
        return build_line_segments([lane.centre for lane in self.driving])

    def find_nearest_lanes(self, xy: Float) -> NearestLanes:
        """Return the nearest lane of each point xy (M, 2) [m]; among equally near lanes the first of `driving`."""
        lane, distance, row = find_nearest_lines(self._segments.rows, self._segments.first, xy)
        return NearestLanes(lane, distance, self._segments.yaw[row])

    def find_lanes_near(self, x: float, y: float, radius: float) -> list[Lane]:
        """Return the lanes with a centre line within `radius` [m] of the point, in the order of `driving`."""
        rows = self._tree.query(shapely.Point(x, y), predicate="dwithin", distance=radius)
        return [self.driving[i] for i in sorted(rows)]

    @cached_property
    def building_shapes(self) -> tuple[shapely.Polygon, ...]:
        """The buildings' outlines."""
        return tuple(shapely.Polygon(building.polygon) for building in self.buildings)


def list_packaged_networks() -> dict[str, Path]:
    """Return the folders of the packaged networks by name."""
    root = Path(str(files("networks")))
    return {folder.name: folder for folder in sorted(root.iterdir()) if (folder / "network.json").is_file()}


def find_network_folder(name: str, beside: Path | None = None) -> Path:
    """Return the folder of a network: `beside`/networks/NAME if it exists, else the packaged one. Raises InputError."""
    if beside is not None and (beside / "networks" / name / "network.json").is_file():
        return beside / "networks" / name
    packaged = Path(str(files("networks")), name)
    if packaged.name == name and (packaged / "network.json").is_file():
        return packaged
    where = f"{beside / 'networks'} or " if beside is not None else ""
    names = ", ".join(list_packaged_networks()) or "none"
    raise InputError(f"network {name!r}: expected in {where}the packaged ones ({names}), found nowhere")


@lru_cache(maxsize=64)  # more than there are packaged networks: a run of a suite loads each once
def load_road_map(folder: Path) -> RoadMap:
    """Load a network folder (`network.json`, `map.net.xml.gz`). Raises InputError. Cached: a RoadMap is immutable."""
    about = read_network_file(folder)
    path = folder / NET_FILE
    xml = _read_net(path)
    if (checksum := compute_net_checksum(xml)) != about.checksum:
        raise InputError(f"{path}: expected the checksum of network.json, {about.checksum}, found {checksum}")
    try:
        return _build_road_map(folder, about, path, _is_left_hand(xml))
    except _NET_ERRORS as error:
        reason = " ".join(str(error).split())[:200]
        raise InputError(f"{path}: expected a SUMO network, found {type(error).__name__}: {reason}") from None


def _read_net(path: Path) -> bytes:
    """Return an uncompressed net; raise InputError, also for one that fills the memory."""
    try:
        with open_regular(path) as packed, gzip.open(packed) as file:
            xml = file.read(MAX_NET_BYTES + 1)
    except (OSError, EOFError, zlib.error) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else error
        raise InputError(f"{path}: cannot be read as a gzipped SUMO network: {reason}") from None
    if len(xml) > MAX_NET_BYTES:
        raise InputError(f"{path}: expected a SUMO network of at most {MAX_NET_BYTES} bytes, found more")
    if b"<!DOCTYPE" in xml:
        raise InputError(f"{path}: expected a SUMO network without a document type, found one")
    return xml


def _is_left_hand(xml: bytes) -> bool:
    """Return whether a net was built for left-hand traffic, which sumolib does not read."""
    root = re.search(rb"<net\s[^>]*>", xml)
    return root is not None and b' lefthand="true"' in root[0]


def _build_road_map(folder: Path, about: NetworkFile, path: Path, left_hand: bool) -> RoadMap:
    net = import_sumolib().net.readNet(str(path), withInternal=True, withPrograms=False)
    raw = [lane for edge in net.getEdges(withInternal=True) for lane in edge.getLanes()]
    check_net_numbers(net, raw)
    cars = {lane.getID(): lane for lane in raw if lane.allows("passenger") and _build_centre_line(lane) is not None}
    foot = [lane for lane in raw if lane.allows("pedestrian") and not lane.allows("passenger")]
    cycles = {
        lane.getID(): lane
        for lane in raw
        if lane.allows("bicycle") and not (lane.allows("passenger") or lane.allows("pedestrian"))
        if _build_centre_line(lane) is not None
    }
    zebras = [lane for lane in foot if lane.getEdge().getFunction() == "crossing"]
    walks = [lane for lane in foot if lane not in zebras]
    return RoadMap(
        name=about.name,
        folder=folder,
        lanes={lane_id: _build_lane(lane, cars, left_hand) for lane_id, lane in sorted(cars.items())},
        junctions=tuple(
            _points(node.getShape())
            for node in net.getNodes()
            if len(node.getShape()) >= 3 and node.getType() != "dead_end"
        ),
        pavements=tuple(_build_outline(lane) for lane in walks),
        crossings=tuple((_points(lane.getShape()), lane.getWidth()) for lane in zebras),
        buildings=about.buildings,
        stop_signs=about.stop_signs,
        checksum=about.checksum,
        crosswalk_pavements=tuple(
            i for i, lane in enumerate(walks) if CROSSWALK_EDGE.fullmatch(lane.getEdge().getID())
        ),
        drivable_areas=about.drivable_areas,
        log_origin=about.log_origin or (0.0, 0.0),
        junction_controls=find_junction_controls(net, cars, _list_signed_lanes(about)),
        roundabout_edges=find_roundabout_edges(net),
        parking=about.parking,
        bus_stops=about.bus_stops,
        footways=tuple(_find_footways(walks)),
        cycle_lanes={lane_id: _build_lane(lane, cycles, left_hand) for lane_id, lane in sorted(cycles.items())},
        yield_signs=about.yield_signs,
    )


def _list_signed_lanes(about: NetworkFile) -> frozenset[str] | None:
    """Return the lanes with a stop sign; None if they are unknown."""
    return None if about.stop_signs is None else frozenset(sign.lane for sign in about.stop_signs)


def _points(shape: Any) -> Float:
    return np.array([point[:2] for point in shape])


def _build_outline(lane: Any) -> Float:
    """Return the outline of a pavement; the shape of a walking area is an outline already."""
    shape = _points(lane.getShape())
    if lane.getEdge().getFunction() == "walkingarea":
        return shape
    strip = shapely.buffer(shapely.LineString(shape), lane.getWidth() / 2, cap_style="flat")
    return shapely.get_coordinates(shapely.get_exterior_ring(strip))


def _find_footways(walks: Sequence[Any]) -> Iterator[Footway]:
    """Return the pavements along edges, without the corners between them."""
    for lane in sorted(walks, key=lambda one: one.getID()):
        centre = None if lane.getEdge().getFunction() else _build_centre_line(lane)
        if centre is not None and not CROSSWALK_EDGE.fullmatch(lane.getEdge().getID()):
            yield Footway(lane.getEdge().getID(), centre, lane.getWidth())


def _build_centre_line(lane: Any) -> Polyline | None:
    """Return the centre line of a sumolib lane; None for a zero-length junction lane, which SUMO may create."""
    try:
        return build_polyline([point[:2] for point in lane.getShape(includeJunctions=False)])
    except ValueError:
        return None


def _build_lane(lane: Any, cars: Mapping[str, Any], left_hand: bool) -> Lane:
    centre = _build_centre_line(lane)
    assert centre is not None
    edge, index = lane.getEdge(), lane.getIndex()
    neighbours = {other.getIndex(): other.getID() for other in edge.getLanes() if other.getID() in cars}
    junction = edge.getFunction() == "internal"
    leftwards = -1 if left_hand else 1
    ways = list(_find_connections(lane, cars))
    return Lane(
        id=lane.getID(),
        edge=edge.getID(),
        index=index,
        width=lane.getWidth(),
        speed_limit=lane.getSpeed(),
        centre=centre,
        junction=junction,
        successors=tuple(dict.fromkeys(successor for successor, _ in ways)),
        left="" if junction else neighbours.get(index + leftwards, ""),
        right="" if junction else neighbours.get(index - leftwards, ""),
        lights={successor: light for successor, light in ways if light},
    )


def _find_connections(lane: Any, cars: Mapping[str, Any]) -> Sequence[tuple[str, str]]:
    """Return (successor lane id, traffic light "tls:index" or "") of every connection of a lane, sorted."""
    connections: list[tuple[str, str]] = []
    for connection in lane.getOutgoing():
        via, light = connection.getViaLaneID(), connection.getTLSID()
        target = via if via in cars else connection.getToLane().getID()
        if target in cars:
            connections.append((target, f"{light}:{connection.getTLLinkIndex()}" if light else ""))
    return sorted(connections)


def import_sumolib() -> ModuleType:
    """Return sumolib, imported without pyproj: 10 MB and 0.15 s in every worker for projections that nothing here uses.

    sumolib does without it if it cannot be imported. Called late, because the rest takes 0.1 s that `--help` should not
    pay.
    """
    is_hidden = "pyproj" not in sys.modules and "sumolib" not in sys.modules
    if is_hidden:
        sys.modules["pyproj"] = None  # pyright: ignore[reportArgumentType] - documented: an import then fails
    try:
        import sumolib
    finally:
        if is_hidden:
            del sys.modules["pyproj"]
    return sumolib


MAX_COORDINATE_M = 1e8
"""[m] Any projection of the earth has smaller ones."""


def check_net_numbers(net: Any, lanes: Sequence[Any]) -> None:
    """Raise ValueError for coordinates, widths or speeds that no road has: products of larger ones overflow."""
    shapes = [lane.getShape() for lane in lanes] + [node.getShape() for node in net.getNodes()]
    for value in chain((number for shape in shapes for point in shape for number in point), *map(_list_numbers, lanes)):
        if not abs(value) <= MAX_COORDINATE_M:
            raise ValueError(f"numbers within {MAX_COORDINATE_M:g} expected, found {value:g}")


def _list_numbers(lane: Any) -> tuple[float, ...]:
    return lane.getWidth(), lane.getSpeed(), lane.getLength()
