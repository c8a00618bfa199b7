"""Streets of the hard tier's corridors: directions, reactive streams, kerbside rows with free places."""

from collections.abc import Sequence
from dataclasses import dataclass

from mdrive_sumo.generate.hard.family_parts import (
    BODY_SIZES,
    Lanes,
    build_vehicle_actor,
    compute_pose,
    find_lane_start,
)
from mdrive_sumo.generate.hard.family_traffic import ParkedRow, TrafficStream, build_parked_row
from mdrive_sumo.roads import RoadMap, find_lane_path
from mdrive_sumo.scenario.scripted_actor import Actor

KERB_ROW_M = 2.8
"""[m] From the centre of the rightmost lane to that of the parking lane beside it: half of 3.3 m and half of 2.3 m."""
PAVEMENT_M = 4.75
"""[m] From the centre of the rightmost lane to the pavement beyond the parking lane."""
JUNCTION_GAP_M = 14.0
"""[m] No vehicle parks closer to the end of a lane."""
WALK_GAP_M = 0.32
"""[m] From the side of a crossing pedestrian's path to the parked vehicle that hides it."""
SHORT_ROW_M = 8.0
"""[m] A shorter kerb has no place for a parked vehicle and its gaps."""


@dataclass(frozen=True, slots=True)
class Corridor:
    """A corridor network: segments 0 to `junctions` in a row, SUMO indices of its driving lanes."""

    network: str
    junctions: int
    lanes: tuple[int, ...]
    """From the right; without the left-turn lane."""
    streams: tuple[TrafficStream, ...]
    """Of side streets."""

    def find_chain(self, roads: RoadMap, direction: str, lane: int, first: int = -1) -> Lanes:
        """Return the lanes straight through; direction: east or west; `first`: segment on which it begins."""
        ends = (0, self.junctions) if direction == "east" else (self.junctions, 0)
        begin = ends[0] if first < 0 else first
        return find_lane_path(roads, f"{direction}_{begin}_{lane}", f"{direction}_{ends[1]}_{lane}")

    @property
    def all_streams(self) -> tuple[TrafficStream, ...]:
        """Reactive streams of both directions and of the side streets."""
        east = tuple(f"east_{k}" for k in range(self.junctions + 1))
        west = tuple(f"west_{k}" for k in range(self.junctions, -1, -1))
        return (TrafficStream(east, self.lanes), TrafficStream(west, self.lanes), *self.streams)


def _build_side_streams(*edges: tuple[str, str]) -> tuple[TrafficStream, ...]:
    return tuple(TrafficStream(pair, (1,), 0.3, large=False) for pair in edges)


CORRIDORS = (
    Corridor("hard_corridor_market", 5, (2, 3), _build_side_streams(
        ("north_1_in", "south_1_out"), ("south_3_in", "north_3_out"), ("north_5_in", "south_5_out"))),
    Corridor("hard_corridor_narrow", 4, (2,), _build_side_streams(
        ("north_2_in", "south_2_out"), ("south_2_in", "north_2_out"), ("north_4_in", "south_4_out"))),
    Corridor("hard_corridor_arterial", 4, (2, 3), tuple(
        TrafficStream(pair, (2,), 0.3, large=False)
        for pair in (("north_1_in", "south_1_out"), ("south_3_in", "north_3_out"), ("north_4_in", "south_4_out")))),
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class FreePlace:
    """A stretch [m] without parked vehicles along a chain; `model` stands directly before it and hides who is there."""

    begin_m: float
    end_m: float
    model: str = "van"


def build_kerbside(
    roads: RoadMap, lanes: Lanes, places: Sequence[FreePlace], between: tuple[float, float], seed: str
) -> list[Actor]:
    """Return the vehicles parked to the right of a chain between two stations [m], except in the free places.

    Ids begin with the id of the chain's first lane.
    """
    made: list[Actor] = []
    for i, place in enumerate(places):
        length = BODY_SIZES[place.model][0]
        pose = compute_pose(roads, lanes, place.begin_m - WALK_GAP_M - length / 2, -KERB_ROW_M)
        made.append(build_vehicle_actor(f"{lanes[0]}.hides{i}", place.model, pose, mirrored=False))
    taken = [(p.begin_m - WALK_GAP_M - BODY_SIZES[p.model][0] - 1.0, p.end_m) for p in places]
    for k, (begin, end) in enumerate(_find_kerbs(roads, lanes, between)):
        for j, (first, last) in enumerate(_cut_out(begin, end, taken)):
            row = ParkedRow(lanes, (first, last), -KERB_ROW_M)
            made += build_parked_row(roads, row, seed, f"{lanes[0]}.row{k}.{j}.")
    return made


def _find_kerbs(roads: RoadMap, lanes: Lanes, between: tuple[float, float]) -> list[tuple[float, float]]:
    """Return the stretches [m] of a chain at which vehicles may park."""
    kerbs: list[tuple[float, float]] = []
    for lane in (roads.lanes[id_] for id_ in lanes if not roads.lanes[id_].junction):
        begin = find_lane_start(roads, lanes, lane.id)
        kerb = (
            max(begin + JUNCTION_GAP_M, between[0]),
            min(begin + lane.centre.length - JUNCTION_GAP_M, between[1]),
        )
        if kerb[1] - kerb[0] > SHORT_ROW_M:
            kerbs.append(kerb)
    return kerbs


def _cut_out(begin: float, end: float, taken: Sequence[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return what is left of a stretch without others."""
    left = [(begin, end)]
    for low, high in taken:
        left = [
            part
            for first, last in left
            for part in ((first, min(last, low)), (max(first, high), last))
            if part[1] > part[0]
        ]
    return left
