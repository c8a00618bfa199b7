"""Rows of parked vehicles along lanes, with free places, and the vehicle that hides a person in one."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import BODIES, BODY_SIZES, build_actor, build_parked_vehicle
from mdrive_sumo.worlds.placement.lane_chains import Lanes, compute_lane_pose, compute_pose
from mdrive_sumo.worlds.placement.occupancy import select_lanes_near

BUMPER_M = 1.0
"""[m] Between the vehicle that hides someone and the one before it."""
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
    """A stretch [m] without parked vehicles along a chain."""

    begin_m: float
    end_m: float
    model: str = "van"
    """Stands directly before it and hides who is there; "": nothing does."""


def build_kerbside(
    roads: RoadMap, rows: Sequence[ParkedRow], places: Sequence[FreePlace], seed: str, prefix: str
) -> list[Actor]:
    """Return the vehicles of the parked rows of one chain of lanes, except in the free places, with that prefix of ids.

    A place without `model` has no vehicle of its own directly before it.
    """
    made: list[Actor] = []
    taken: list[tuple[float, float]] = []
    for i, place in enumerate(places):
        row = next((row for row in rows if row.between[0] <= place.begin_m <= row.between[1]), None)
        taken.append((place.begin_m, place.end_m))
        if place.model and row is not None:
            length = BODY_SIZES[place.model][0]
            pose = compute_pose(roads, row.lanes, place.begin_m - WALK_GAP_M - length / 2, row.offset)
            made.append(build_parked_vehicle(f"{prefix}hides{i}", place.model, pose, mirrored=False))
            taken[-1] = (place.begin_m - WALK_GAP_M - length - BUMPER_M, place.end_m)
    for k, row in enumerate(rows):
        for j, part in enumerate(_cut_out(*row.between, taken)):
            made += build_parked_row(roads, replace(row, between=part), seed, f"{prefix}{k}.{j}.")
    return made


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
