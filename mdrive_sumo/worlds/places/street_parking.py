"""Rows of parked vehicles and bus stops beside a street: where they may be, and what the draft says of them."""

import random
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.roads.network_file import BusStop, ParkingRow
from mdrive_sumo.worlds.places.alignment import buffer_line, cut_line, shift_line
from mdrive_sumo.worlds.places.draft_edge import DraftEdge
from mdrive_sumo.worlds.places.frontage import build_box
from mdrive_sumo.worlds.places.network_draft import NetworkDraft
from mdrive_sumo.worlds.places.street_spine import Spine

STALL_M = 5.7
"""[m] Length of a stall along a street (RASt 06, section 6.1.5.2: 5.20 m to 6.70 m with the gap to the next)."""
ISLAND_M = 2.5
"""[m] A planted island between two bays; chosen for a tree with its disc."""
LEAST_ROW_M = 6.0
"""[m] Shorter rows have no room for a stall."""
CORNER_M = 5.0
"""[m] No vehicle parks nearer than that to the edge of a street that joins (StVO section 12(3) no. 1)."""
DRIVEWAY = "driveway"
"""Beginning of the ids of joints that are driveways."""
DRIVEWAY_CORNER_M = 0.5
"""[m] No vehicle parks in front of a driveway (StVO section 12(3) no. 3), and half a metre beside it; chosen."""
TREE_M = 0.5
"""[m] Width of a trunk; chosen."""
CYCLE_M = 1.85
"""[m] Width of a cycle lane with its line (ERA 2010, table 5)."""
ZEBRA_M = 5.0
"""[m] No vehicle parks nearer than that before a zebra crossing (StVO, sign 293)."""
BUS_STOP_M = 18.0
"""[m] Length of a kerb where a bus of 12 m stops (RASt 06, section 6.1.10.8: 12 m and room to leave); chosen."""


@dataclass(frozen=True, slots=True)
class Closure:
    """A part of an edge where parking is forbidden."""

    begin: float
    """Station [m] along the edge."""
    end: float


def add_parking(
    draft: NetworkDraft, edge: DraftEdge, closures: Sequence[Closure], stalls: tuple[int, int], rng: random.Random
) -> list[float]:
    """Add rows on the parking lane of an edge, between its closures; return the stations of the islands between them.

    stalls: least and largest number of stalls of a row.
    """
    index = next(i for i, lane in enumerate(edge.lanes) if lane.use == "park")
    islands: list[float] = []
    for begin, end in _list_gaps(edge, closures):
        station = begin
        while end - station >= LEAST_ROW_M:
            length = min(rng.randint(*stalls) * STALL_M, end - station)
            _add_row(draft, edge, index, station, station + length)
            station += length + ISLAND_M
            if end - station >= LEAST_ROW_M:
                islands.append(station - ISLAND_M / 2)
    return islands


def _add_row(draft: NetworkDraft, edge: DraftEdge, index: int, begin: float, end: float) -> None:
    part, width = cut_line(edge.line, begin, end), edge.lanes[index].width_m
    centre = edge.find_centre(index)
    line = np.round(shift_line(part, -centre).xy, 2).tolist()
    row = ParkingRow(id=f"row_{len(draft.parking) + 1}", line=tuple((x, y) for x, y in line), width_m=width)
    draft.parking.append(row)
    draft.paved_areas.append(buffer_line(part, -(centre - width / 2), centre + width / 2))


def _list_gaps(edge: DraftEdge, closures: Sequence[Closure]) -> list[tuple[float, float]]:
    """Return the parts of an edge that are not closed."""
    gaps: list[tuple[float, float]] = []
    station = 0.0
    for closure in sorted(closures, key=lambda closure: closure.begin):
        if closure.begin - station >= LEAST_ROW_M:
            gaps.append((station, closure.begin))
        station = max(station, closure.end)
    if edge.line.length - station >= LEAST_ROW_M:
        gaps.append((station, edge.line.length))
    return gaps


def add_bus_stop(draft: NetworkDraft, edge: DraftEdge, station: float) -> Closure:
    """Add a bus stop on the rightmost lane for cars, around a station; return where parking is forbidden for it."""
    index = edge.car_lanes[0]
    begin, end = station - BUS_STOP_M / 2, station + BUS_STOP_M / 2
    line = np.round(shift_line(cut_line(edge.line, begin, end), -edge.find_centre(index)).xy, 2).tolist()
    name = f"bus_stop_{len(draft.bus_stops) + 1}"
    draft.bus_stops.append(BusStop(id=name, lane=f"{edge.id}_{index}", line=tuple((x, y) for x, y in line)))
    return Closure(begin, end)


def pave_cycle_lane(draft: NetworkDraft, edge: DraftEdge) -> None:
    """Add the cycle lane of an edge to the paved areas, which pictures show."""
    if edge.cycle_lane is not None:
        centre, width = edge.find_centre(edge.cycle_lane), edge.lanes[edge.cycle_lane].width_m
        draft.paved_areas.append(buffer_line(edge.line, -(centre - width / 2), centre + width / 2))


def add_tree(draft: NetworkDraft, edge: DraftEdge, station: float) -> None:
    """Add the trunk of a tree on the parking lane of an edge, between two rows."""
    index = next(i for i, lane in enumerate(edge.lanes) if lane.use == "park")
    draft.obstacles.append(("tree", build_box(edge.line, station, -edge.find_centre(index), TREE_M, TREE_M)))


def close_ends(spine: Spine, edge: DraftEdge) -> list[Closure]:
    """Return where parking is forbidden on an edge: at its junctions and zebra crossings."""
    reach = {"begin": 3.0, "end": 3.0}
    for joint in spine.plan.joints:
        half = max((arm.half.width_m for arm in joint.arms), default=0.0)
        corner = DRIVEWAY_CORNER_M if joint.id.startswith(DRIVEWAY) else CORNER_M
        crossing = 3.5 if {"before", "after"} & set(joint.zebras) else 0.0
        reach[joint.id] = half + joint.radius + corner + crossing if joint.arms else crossing + ZEBRA_M
    length = edge.line.length
    return [Closure(0.0, reach.get(edge.begin, 0.0)), Closure(length - reach.get(edge.end, 0.0), length)]
