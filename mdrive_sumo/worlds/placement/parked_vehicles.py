"""Rows of parked vehicles along lanes, with free places, and the vehicle that hides a person in one."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import BODIES, BODY_SIZES, build_actor, build_parked_vehicle
from mdrive_sumo.worlds.placement.lane_chains import Lanes, compute_lane_pose, compute_pose, find_lane_start
from mdrive_sumo.worlds.placement.occupancy import select_lanes_near

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
LANE_END_M = 6.0
"""[m] No drawn vehicle parks nearer to the end of a lane."""
PARKED_NEAR_M = 70.0
"""[m] Drawn vehicles park within this distance of the start of a CAV."""
PARKED_MODELS = {"parked-car": 0.68, "parked-van": 0.24, "parked-truck": 0.08}
"""Share of each model among them; vans and trucks hide the most."""


@dataclass(frozen=True, slots=True)
class ParkedRow:
    """A row of parked vehicles along a chain of lanes."""

    lanes: Lanes
    between: tuple[float, float]
    """Stations [m] of its ends along the chain."""
    offset: float
    """[m] To the left of the chain's centre line; negative: to the right."""
    van_share: float = 0.3
    """Share of vans, the others are cars."""
    occupied: float = 1.0
    """Share of the places that are taken."""


def build_parked_row(roads: RoadMap, row: ParkedRow, seed: str, prefix: str) -> tuple[Actor, ...]:
    """Return the vehicles of a row, drawn by the seed, from its end back; their ids begin with the prefix."""
    rng = random.Random(f"{seed}/{prefix}")
    made: list[Actor] = []
    end = row.between[1]
    while True:
        model = "van" if rng.random() < row.van_share else "car"
        length, gap = BODY_SIZES[model][0], rng.uniform(0.8, 1.6)
        if end - length < row.between[0]:
            return tuple(made)
        if rng.random() < row.occupied:
            pose = compute_pose(roads, row.lanes, end - length / 2, row.offset)
            made.append(build_parked_vehicle(f"{prefix}{len(made)}", model, pose, mirrored=False))
        end -= length + gap


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
        made.append(build_parked_vehicle(f"{lanes[0]}.hides{i}", place.model, pose, mirrored=False))
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


def build_parked_vehicles(roads: RoadMap, egos: Sequence[Ego], count: int, rng: random.Random) -> Iterator[Actor]:
    """Return vehicles parked at the right edge of the road near the CAVs, mostly beside the lane."""
    kerbs = [lane for lane in roads.driving if not (lane.junction or lane.right)]
    long = [lane for lane in kerbs if lane.centre.length > 2 * LANE_END_M + SHORT_ROW_M + 1.0]
    lanes = select_lanes_near(long, egos, PARKED_NEAR_M)
    for number in range(count if lanes else 0):
        lane = rng.choices(lanes, [lane.centre.length for lane in lanes])[0]
        yield _build_parked_vehicle(lane, f"parked_{number}", rng)


def _build_parked_vehicle(lane: Lane, name: str, rng: random.Random) -> Actor:
    model = rng.choices(list(PARKED_MODELS), list(PARKED_MODELS.values()))[0]
    body = BODIES[model]
    station = rng.uniform(LANE_END_M + body.length / 2, lane.centre.length - LANE_END_M - body.length / 2)
    offset = lane.width / 2 + body.width / 2 + rng.uniform(-0.3, 0.6)
    return build_actor(name, body, compute_lane_pose(lane, station, -offset))
