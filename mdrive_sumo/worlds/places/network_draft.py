"""NetworkDraft: nodes, streets, connections, buildings and signs of a network before netconvert compiles it."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.roads.network_file import (
    NETWORK_FILE,
    Building,
    BusStop,
    DrivableArea,
    NetworkFile,
    ParkingRow,
    StopSignBox,
    YieldSign,
)
from mdrive_sumo.worlds.places.draft_edge import DraftEdge
from mdrive_sumo.worlds.places.street_lines import cut_line, measure_line, offset_line

LANE_M = 3.5
"""[m] Width of a lane unless a network says otherwise."""
STOP_BOX_M = 5.0
"""[m] Length of the box of a stop sign, as on the other packaged networks."""
NODES, EDGES, CONNECTIONS, PROGRAMS = "plain.nod.xml", "plain.edg.xml", "plain.con.xml", "plain.tll.xml"
NO_PARKING_M = 5.0
"""[m] Kept free before and behind the corners of junctions, and before zebra crossings (StVO § 12)."""
END_M = 3.0
"""[m] Kept free at the end of a street that has no junction there."""
LEAST_ROW_M = 8.0
"""[m] Length of a row for one car that pulls in forwards."""
ZEBRA_M = 3.5
"""[m] Width of a zebra crossing; German guidelines (R-FGÜ 2001) ask for 3 m or more."""


@dataclass(frozen=True, slots=True)
class Node:
    """A junction or the end of a street."""

    id: str
    x: float
    y: float
    type: str = ""
    """SUMO's junction type; "" leaves it to netconvert."""
    radius: float = 5.0
    """[m] Of the corners."""
    signal: str = ""
    """Id of a signal that several junctions share."""


@dataclass(frozen=True, eq=False)
class Street:
    """A street between two nodes: one edge for each direction that has lanes.

    From the line outwards lie the lanes for cars, a cycle lane, a parking lane and a pavement; SUMO counts them from
    the other side, so the pavement has index 0. Use `first_car_lane` for connections.
    """

    id: str
    begin: str
    end: str
    line: Float
    """Points (N, 2) [m] from begin to end; lanes lie to the right of it in their direction, or, if centred, on it."""
    lanes: tuple[int, int] = (1, 1)
    """Lanes for cars along the line, and against it."""
    speed: float = 13.89
    priority: int = 3
    sidewalk_m: float = 0.0
    """Width of the pavement [m]; 0: none."""
    centred: bool = False
    names: tuple[str, str] = ("", "")
    """Ids of both edges, else ID_in and ID_out."""
    cycle_m: float = 0.0
    """Width of a cycle lane [m] in each direction; 0: none."""
    parking_m: float = 0.0
    """Width of a parking lane [m], which no vehicle drives on; 0: none."""

    @property
    def edge_ids(self) -> tuple[str, str]:
        """Ids of the edge along the line and of the one against it."""
        return self.names[0] or f"{self.id}_in", self.names[1] or f"{self.id}_out"

    @property
    def first_car_lane(self) -> int:
        """Index of the rightmost lane for cars."""
        return (self.sidewalk_m > 0) + (self.parking_m > 0) + (self.cycle_m > 0)

    @property
    def beside_m(self) -> float:
        """Width [m] of what lies between the lanes for cars and the edge of the street."""
        return self.cycle_m + self.parking_m + self.sidewalk_m


@dataclass(eq=False)
class NetworkDraft:
    """A network before it is compiled."""

    name: str
    description: str
    lane_m: float = LANE_M
    nodes: list[Node] = field(default_factory=list[Node])
    streets: list[Street] = field(default_factory=list[Street])
    edges: list[DraftEdge] = field(default_factory=list[DraftEdge])
    """Roads in one direction whose lanes differ in use and width; streets are for the others."""
    connections: list[tuple[str, int, str, int]] = field(default_factory=list[tuple[str, int, str, int]])
    """Connections: from edge and lane, to edge and lane."""
    crossings: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    """Zebra crossings: node, and the edges that they cross."""
    ring: tuple[Sequence[str], Sequence[str]] = ((), ())
    """Nodes and edges of a roundabout."""
    buildings: list[Float] = field(default_factory=list[Float])
    """Outlines (K, 2) [m]."""
    obstacles: list[tuple[str, Float]] = field(default_factory=list[tuple[str, Float]])
    """What else blocks sight: kind ("hedge", "wall", "tree", "shelter", ...) and outline (K, 2) [m]."""
    stops: list[str] = field(default_factory=list[str])
    """Edges with a stop sign at their end."""
    yields: list[str] = field(default_factory=list[str])
    """Edges with a yield sign at their end."""
    paved_areas: list[Float] = field(default_factory=list[Float])
    """Outlines (K, 2) [m] of asphalt beyond the lanes: car parks, lay-bys."""
    parking: list[ParkingRow] = field(default_factory=list[ParkingRow])
    """Where vehicles park beyond the parking lanes of streets, which get rows by themselves."""
    bus_stops: list[BusStop] = field(default_factory=list[BusStop])
    programs: list[str] = field(default_factory=list[str])
    """XML elements of programs of signals and of their links; netconvert makes up those that there are not."""
    netconvert: tuple[str, ...] = ()
    """Further arguments."""

    def write_recipe(self, folder: Path) -> None:
        """Write plain XML and `network.json`; offset, checksum and signs come when it is compiled."""
        make_folder(folder)
        has_connections = bool(self.connections or self.crossings)
        write_text(folder / NODES, self._build_nodes())
        write_text(folder / EDGES, self._build_edges())
        if has_connections:
            write_text(folder / CONNECTIONS, self._build_connections())
        if self.programs:
            write_text(folder / PROGRAMS, self._wrap("tlLogics", [f"    {row}" for row in self.programs]))
        files = ["--node-files", NODES, "--edge-files", EDGES] + ["--connection-files", CONNECTIONS] * has_connections
        files += ["--tllogic-files", PROGRAMS] * bool(self.programs)
        self._write_network_file(folder, (*files, *_list_common_arguments(self.lane_m), *self.netconvert))

    def add_signs(self, folder: Path, length_by_lane: Mapping[str, float]) -> None:
        """Write the signs into `network.json`: at the ends of compiled lanes for cars."""
        about = NetworkFile.model_validate_json((folder / NETWORK_FILE).read_bytes())
        ends = [(lane, round(length - 0.1, 1)) for lane, length in sorted(length_by_lane.items())]
        stops = tuple(
            StopSignBox(id=f"{lane}_stop", lane=lane, line_pos_m=end_m, length_m=STOP_BOX_M)
            for lane, end_m in ends
            if lane.rpartition("_")[0] in self.stops
        )
        yields = tuple(
            YieldSign(id=f"{lane}_yield", lane=lane, line_pos_m=end_m)
            for lane, end_m in ends
            if lane.rpartition("_")[0] in self.yields
        )
        signed = about.model_copy(update={"stop_signs": stops, "yield_signs": yields})
        write_text(folder / NETWORK_FILE, signed.model_dump_json(indent=1) + "\n")

    def _write_network_file(self, folder: Path, build: tuple[str, ...]) -> None:
        outlines = [("house", outline) for outline in self.buildings] + self.obstacles
        count: dict[str, int] = {}
        buildings: list[Building] = []
        for kind, outline in outlines:
            count[kind] = count.get(kind, 0) + 1
            buildings.append(Building(id=f"{kind}_{count[kind]}", polygon=_round_outline(outline)))
        written = NetworkFile(
            name=self.name,
            description=self.description,
            origin="made for mdrive-sumo",
            licence="Apache-2.0",
            offset=(0.0, 0.0),
            build=build,
            checksum="",
            buildings=tuple(buildings),
            stop_signs=(),
            drivable_areas=tuple(DrivableArea(outline=_round_outline(area)) for area in self._list_paved_areas()),
            parking=(*self._build_parking_rows(), *self.parking),
            bus_stops=tuple(self.bus_stops),
        )
        write_text(folder / NETWORK_FILE, written.model_dump_json(indent=1) + "\n")

    def _build_parking_rows(self) -> Iterator[ParkingRow]:
        """Return the row of each parking lane, in driving direction, without the parts beside junctions."""
        for street in self.streets:
            free = [self._measure_no_parking(node) for node in (street.begin, street.end)]
            for sign, count, name in zip((-1, 1), street.lanes, street.edge_ids, strict=True):
                if not (street.parking_m and count and measure_line(street.line) > sum(free) + LEAST_ROW_M):
                    continue
                offset_m = count * self.lane_m + street.cycle_m + street.parking_m / 2
                points = cut_line(offset_line(street.line, sign * offset_m), *free)
                row = _round_outline(points if sign < 0 else points[::-1])
                yield ParkingRow(id=f"{name}_parking", line=row, width_m=street.parking_m)

    def _measure_no_parking(self, name: str) -> float:
        """Return the distance [m] from a node within which parking is forbidden."""
        node = next(node for node in self.nodes if node.id == name)
        if not node.type:
            return END_M
        streets = [street for street in self.streets if name in (street.begin, street.end)]
        half_m = max(max(street.lanes) * self.lane_m + street.beside_m for street in streets)
        is_crossed = any(crossing == name for crossing, _ in self.crossings)
        return half_m + node.radius + NO_PARKING_M + (ZEBRA_M if is_crossed else 0.0)

    def _list_paved_areas(self) -> Iterator[Float]:
        """Return the outlines of parking and cycle lanes, which pictures do not show otherwise, and of other areas."""
        for street in self.streets:
            width = street.cycle_m + street.parking_m
            for sign, count in zip((-1, 1), street.lanes, strict=True):
                if width and count:
                    near = offset_line(street.line, sign * count * self.lane_m)
                    far = offset_line(street.line, sign * (count * self.lane_m + width))
                    yield np.concatenate((near, far[::-1]))
        yield from self.paved_areas

    def _build_nodes(self) -> str:
        rows = [
            f'    <node id="{n.id}" x="{n.x:.1f}" y="{n.y:.1f}"'
            + (f' type="{n.type}" radius="{n.radius:g}"' if n.type else "")
            + (f' tl="{n.signal}"/>' if n.signal else "/>")
            for n in self.nodes
        ]
        return self._wrap("nodes", rows)

    def _build_edges(self) -> str:
        rows: list[str] = []
        for street in self.streets:
            ends = (street.begin, street.end)
            for forward, (name, count) in enumerate(
                zip(reversed(street.edge_ids), reversed(street.lanes), strict=True)
            ):
                if count:
                    begin, end = ends if forward else ends[::-1]
                    rows.append(
                        _build_edge(street, name, (begin, end), count, street.line if forward else street.line[::-1])
                    )
        rows += [edge.format_xml() for edge in self.edges]
        if self.ring[0]:
            rows.append(f'    <roundabout nodes="{" ".join(self.ring[0])}" edges="{" ".join(self.ring[1])}"/>')
        return self._wrap("edges", rows)

    def _build_connections(self) -> str:
        rows = [f'    <connection from="{a}" to="{b}" fromLane="{i}" toLane="{j}"/>' for a, i, b, j in self.connections]
        rows += [f'    <crossing node="{node}" edges="{edges}" width="{ZEBRA_M:g}"/>' for node, edges in self.crossings]
        return self._wrap("connections", rows)

    def _wrap(self, tag: str, rows: Sequence[str]) -> str:
        return "\n".join((f"<!-- {self.description} -->", f"<{tag}>", *rows, f"</{tag}>", ""))


def _round_outline(outline: Float) -> tuple[tuple[float, float], ...]:
    return tuple((x, y) for x, y in np.round(outline, 1).tolist())


def _build_edge(street: Street, name: str, ends: tuple[str, str], count: int, line: Float) -> str:
    shape = " ".join(f"{x:.1f},{y:.1f}" for x, y in line.tolist())
    spread = ' spreadType="center"' if street.centred else ""
    has_own_lanes = street.cycle_m > 0 or street.parking_m > 0
    walk = f' sidewalkWidth="{street.sidewalk_m:g}"' if street.sidewalk_m and not has_own_lanes else ""
    edge = (
        f'    <edge id="{name}" from="{ends[0]}" to="{ends[1]}"'
        f' numLanes="{count + street.first_car_lane if has_own_lanes else count}" speed="{street.speed:g}"'
        f' priority="{street.priority}"{spread}{walk} shape="{shape}"'
    )
    return f"{edge}>\n{_build_lanes(street, count)}\n    </edge>" if has_own_lanes else f"{edge}/>"


def _build_lanes(street: Street, count: int) -> str:
    """Return the lanes of an edge from the kerb to the line."""
    beside = (
        ('allow="pedestrian"', street.sidewalk_m),
        ('disallow="all"', street.parking_m),
        ('allow="bicycle"', street.cycle_m),
    )
    lanes = [f'{permission} width="{width:g}"' for permission, width in beside if width]
    lanes += ['disallow="pedestrian"'] * count
    return "\n".join(f'        <lane index="{i}" {attributes}/>' for i, attributes in enumerate(lanes))


def _list_common_arguments(lane_m: float) -> tuple[str, ...]:
    """Return netconvert's arguments that all packaged networks share."""
    return (
        "--default.lanewidth",
        f"{lane_m:g}",
        "--no-turnarounds",
        "true",
        "--offset.disable-normalization",
        "true",
        "--junctions.internal-link-detail",
        "13",
        "--junctions.corner-detail",
        "6",
        "--junctions.limit-turn-speed",
        "-1",
        "--precision",
        "3",
    )
