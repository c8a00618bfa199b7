"""NetworkDraft: nodes, streets and connections of a training network, and the recipe files that they make."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.roads.network_file import NETWORK_FILE, Building, NetworkFile, StopSignBox

LANE_M = 3.5
"""[m] Width of a lane unless a network says otherwise."""
STOP_BOX_M = 5.0
"""[m] Length of the box of a stop sign, as on the other packaged networks."""
NODES, EDGES, CONNECTIONS = "plain.nod.xml", "plain.edg.xml", "plain.con.xml"


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


@dataclass(frozen=True, eq=False)
class Street:
    """A street between two nodes: one edge for each direction that has lanes."""

    id: str
    begin: str
    end: str
    line: Float
    """Points (N, 2) [m] from begin to end; lanes lie to the right of it in their direction, or, if centred, on it."""
    lanes: tuple[int, int] = (1, 1)
    """Lanes along the line, and against it."""
    speed: float = 13.89
    priority: int = 3
    sidewalk_m: float = 0.0
    centred: bool = False
    names: tuple[str, str] = ("", "")
    """Ids of both edges, else ID_in and ID_out."""

    @property
    def edge_ids(self) -> tuple[str, str]:
        """Ids of the edge along the line and of the one against it."""
        return self.names[0] or f"{self.id}_in", self.names[1] or f"{self.id}_out"


@dataclass(eq=False)
class NetworkDraft:
    """A network before it is compiled."""

    name: str
    description: str
    lane_m: float = LANE_M
    nodes: list[Node] = field(default_factory=list[Node])
    streets: list[Street] = field(default_factory=list[Street])
    connections: list[tuple[str, int, str, int]] = field(default_factory=list[tuple[str, int, str, int]])
    """Connections: from edge and lane, to edge and lane."""
    crossings: list[tuple[str, str]] = field(default_factory=list[tuple[str, str]])
    """Zebra crossings: node, and the edges that they cross."""
    ring: tuple[Sequence[str], Sequence[str]] = ((), ())
    """Nodes and edges of a roundabout."""
    buildings: list[Float] = field(default_factory=list[Float])
    """Outlines (K, 2) [m]."""
    stops: list[str] = field(default_factory=list[str])
    """Edges with a stop sign at their end."""
    netconvert: tuple[str, ...] = ()
    """Further arguments."""

    def write_recipe(self, folder: Path) -> None:
        """Write plain XML and `network.json`; offset, checksum and stop signs come when it is compiled."""
        make_folder(folder)
        has_connections = bool(self.connections or self.crossings)
        write_text(folder / NODES, self._build_nodes())
        write_text(folder / EDGES, self._build_edges())
        if has_connections:
            write_text(folder / CONNECTIONS, self._build_connections())
        files = ["--node-files", NODES, "--edge-files", EDGES] + ["--connection-files", CONNECTIONS] * has_connections
        self._write_network_file(folder, (*files, *_list_common_arguments(self.lane_m), *self.netconvert), ())

    def add_stop_signs(self, folder: Path, length_by_lane: dict[str, float]) -> None:
        """Write the stop signs into `network.json`: at the ends of compiled lanes."""
        about = NetworkFile.model_validate_json((folder / NETWORK_FILE).read_bytes())
        signs = tuple(
            StopSignBox(id=f"{lane}_stop", lane=lane, line_pos_m=round(length - 0.1, 1), length_m=STOP_BOX_M)
            for lane, length in sorted(length_by_lane.items())
            if lane.rpartition("_")[0] in self.stops
        )
        self._write_network_file(folder, about.build, signs, about)

    def _write_network_file(
        self, folder: Path, build: tuple[str, ...], signs: tuple[StopSignBox, ...], about: NetworkFile | None = None
    ) -> None:
        houses = tuple(
            Building(id=f"house_{i}", polygon=tuple((x, y) for x, y in np.round(outline, 1).tolist()))
            for i, outline in enumerate(self.buildings, 1)
        )
        written = NetworkFile(
            name=self.name,
            description=self.description,
            origin="made for mdrive-sumo",
            licence="Apache-2.0",
            offset=about.offset if about else (0.0, 0.0),
            build=build,
            checksum=about.checksum if about else "",
            buildings=houses,
            stop_signs=signs,
        )
        write_text(folder / NETWORK_FILE, written.model_dump_json(indent=1) + "\n")

    def _build_nodes(self) -> str:
        rows = [
            f'    <node id="{n.id}" x="{n.x:.1f}" y="{n.y:.1f}"'
            + (f' type="{n.type}" radius="{n.radius:g}"/>' if n.type else "/>")
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
        if self.ring[0]:
            rows.append(f'    <roundabout nodes="{" ".join(self.ring[0])}" edges="{" ".join(self.ring[1])}"/>')
        return self._wrap("edges", rows)

    def _build_connections(self) -> str:
        rows = [f'    <connection from="{a}" to="{b}" fromLane="{i}" toLane="{j}"/>' for a, i, b, j in self.connections]
        rows += [f'    <crossing node="{node}" edges="{edges}" width="3.5"/>' for node, edges in self.crossings]
        return self._wrap("connections", rows)

    def _wrap(self, tag: str, rows: Sequence[str]) -> str:
        return "\n".join((f"<!-- {self.description} -->", f"<{tag}>", *rows, f"</{tag}>", ""))


def _build_edge(street: Street, name: str, ends: tuple[str, str], count: int, line: Float) -> str:
    shape = " ".join(f"{x:.1f},{y:.1f}" for x, y in line.tolist())
    spread = ' spreadType="center"' if street.centred else ""
    walk = f' sidewalkWidth="{street.sidewalk_m:g}"' if street.sidewalk_m else ""
    return (
        f'    <edge id="{name}" from="{ends[0]}" to="{ends[1]}" numLanes="{count}" speed="{street.speed:g}"'
        f' priority="{street.priority}"{spread}{walk} shape="{shape}"/>'
    )


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
