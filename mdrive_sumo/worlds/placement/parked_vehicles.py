"""Vehicles parked at the kerb near CAVs."""

import random
from collections.abc import Iterator, Sequence

from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.worlds.placement.bodies import BODIES, build_actor
from mdrive_sumo.worlds.placement.lane_chains import compute_lane_pose
from mdrive_sumo.worlds.placement.occupancy import select_lanes_near

SHORT_ROW_M = 8.0
"""[m] A shorter kerb has no place for a parked vehicle and its gaps."""
LANE_END_M = 6.0
"""[m] No drawn vehicle parks nearer to the end of a lane."""
PARKED_NEAR_M = 70.0
"""[m] Drawn vehicles park within this distance of the start of a CAV."""
PARKED_MODELS = {"parked-car": 0.68, "parked-van": 0.24, "parked-truck": 0.08}
"""Share of each model among them; vans and trucks hide the most."""


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
