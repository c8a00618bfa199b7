"""Pedestrians, cyclists and parked vehicles of a synthetic recording: scripted actors beside the lanes.

Pedestrians walk on pavements, stand at corners, and use crossings when lights allow it, or at any time without lights;
then they stand. Cyclists ride along kerbs without parked vehicles. Both networks have the same cross-section on every
road: car lanes, 2.2 m of parking, a pavement of 2.5 m (`networks/city_crossing`, `networks/city_corridor`).
"""

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion, TimeTrigger
from mdrive_sumo.worlds.placement.bodies import BODIES, build_actor, build_rider
from mdrive_sumo.worlds.placement.lane_chains import build_pose, compute_lane_pose
from mdrive_sumo.worlds.placement.parked_vehicles import ParkedRow, build_parked_row
from mdrive_sumo.worlds.signalled_crossings import SignalledCrossing, find_signalled_crossings

PARKING_M, PAVEMENT_M = 2.2, 2.5
"""Widths in the recipes of the networks."""
RIDE_M = 0.6
"""[m] Distance of cyclists from the lane's edge, in the empty parking strip."""
STEP_M = 3.0
"""[m] Between points of a path."""
CLEAR_M = 12.0
"""[m] No parking this close to a junction."""
VAN_SHARE = 0.15
"""Share of vans among parked vehicles."""
WAIT_M, BEYOND_M = 1.8, 3.0
"""[m] Distance from the kerb while waiting, and distance beyond the other kerb."""


@dataclass(frozen=True)
class PopulationCounts:
    """Number of road users of each kind."""

    walkers: int
    waiting: int
    crossing: int
    cyclists: int
    parked_share: float
    """Share of the parking places that are taken."""


def find_kerb_lanes(roads: RoadMap) -> list[Lane]:
    """Return the rightmost car lane of every road."""
    return [lane for lane in roads.driving if not lane.junction and not lane.right]


def compute_walking_pose(lane: Lane, s: float, aside: float) -> Pose:
    """Return a pose on the pavement, `aside` from -1 (at the kerb) to 1 (at the houses)."""
    return compute_lane_pose(lane, s, -(lane.width / 2 + PARKING_M + PAVEMENT_M / 2 * (1 + 0.8 * aside)))


def build_people(roads: RoadMap, count: PopulationCounts, until_s: float, rng: random.Random) -> tuple[Actor, ...]:
    """Build all of them; `until_s` [s] is the latest time at which a pedestrian begins to cross."""
    lanes = find_kerb_lanes(roads)
    strips = {lane.id for lane in rng.sample(lanes, max(len(lanes) // 4, 2))}
    cycle_lanes = [lane for lane in lanes if lane.id in strips]
    crossings = find_signalled_crossings(roads)
    seed = str(rng.getrandbits(64))
    rows = [
        ParkedRow((lane.id,), (CLEAR_M, lane.centre.length - CLEAR_M), offset, VAN_SHARE, count.parked_share)
        for lane in lanes
        if lane.id not in strips
        for offset in (-(lane.width + PARKING_M) / 2,)
    ]
    return (
        *(_build_walker(f"walker{n}", rng.choice(lanes), rng) for n in range(count.walkers)),
        *(_build_waiting(f"waiting{n}", rng.choice(lanes), rng) for n in range(count.waiting)),
        *(_build_crossing(f"crossing{n}", rng.choice(crossings), until_s, rng) for n in range(count.crossing)),
        *_build_cyclists(cycle_lanes, count.cyclists, until_s, rng),
        *(car for n, row in enumerate(rows) for car in build_parked_row(roads, row, seed, f"parked{n}.")),
    )


def _build_walker(name: str, lane: Lane, rng: random.Random) -> Actor:
    """Return a pedestrian who walks up and down; walking beyond the path would lead onto the road."""
    aside, speed = rng.uniform(-1.0, 1.0), round(rng.triangular(0.7, 1.9, 1.3), 2)
    begin, far, near = rng.uniform(3.0, lane.centre.length - 3.0), lane.centre.length - 1.0, 1.0
    is_ahead = rng.random() < 0.5
    turns = (begin, far, near, far) if is_ahead else (begin, near, far, near)
    stations = [begin, *(s for ends in pairwise(turns) for s in _space_stations(*ends)[1:])]
    first, *others = (compute_walking_pose(lane, s, aside) for s in stations)
    first = build_pose(first.x, first.y, first.yaw + (0.0 if is_ahead else math.pi))
    return build_rider(name, BODIES["adult"], (first, *others), speed)


def _space_stations(begin: float, end: float) -> list[float]:
    return np.linspace(begin, end, max(round(abs(end - begin) / STEP_M), 1) + 1).tolist()


def _build_waiting(name: str, lane: Lane, rng: random.Random) -> Actor:
    """Return a standing pedestrian, most of them near a junction."""
    s = min(rng.expovariate(0.1), lane.centre.length - 1.0)
    pose = compute_walking_pose(lane, lane.centre.length - s if lane.successors else s, rng.uniform(-1.0, 1.0))
    return build_actor(name, BODIES["adult"], build_pose(pose.x, pose.y, rng.uniform(-math.pi, math.pi)))


def _build_crossing(name: str, zebra: SignalledCrossing, until_s: float, rng: random.Random) -> Actor:
    (x0, y0), (x1, y1) = zebra.line[:: rng.choice((1, -1))].tolist()
    yaw = portable.atan2(y1 - y0, x1 - x0)
    ahead, aside = (portable.cos(yaw), portable.sin(yaw)), rng.uniform(-1.3, 1.3)
    start = build_pose(x0 - WAIT_M * ahead[0], y0 - WAIT_M * ahead[1], yaw, aside)
    goal = build_pose(x1 + BEYOND_M * ahead[0], y1 + BEYOND_M * ahead[1], yaw, aside)
    begin_s = _draw_crossing_time(zebra, until_s, rng)
    walk_s = portable.hypot(goal.x - start.x, goal.y - start.y) / rng.triangular(1.0, 1.9, 1.4)
    times = ((0.0, start), (begin_s, start), (round(begin_s + walk_s, 2), goal))
    motion = ReplayMotion(poses=tuple((t, pose.x, pose.y, pose.yaw) for t, pose in times), stays=True)
    return build_actor(name, BODIES["adult"], start, motion=motion)


def _draw_crossing_time(zebra: SignalledCrossing, until_s: float, rng: random.Random) -> float:
    """Draw a time within the first two thirds of a green interval, or any time."""
    if not zebra.green:
        return round(rng.uniform(0.05, until_s), 2)
    cycles = range(int(until_s // zebra.cycle_s) + 1)
    begin, length = rng.choice([(begin + k * zebra.cycle_s, end - begin) for k in cycles for begin, end in zebra.green])
    return round(begin + rng.uniform(0.05, length * 2 / 3), 2)


def _build_cyclists(lanes: Sequence[Lane], count: int, until_s: float, rng: random.Random) -> Iterator[Actor]:
    for n in range(count):
        lane = lanes[n % len(lanes)]
        begin, end = 4.0 + 10.0 * (n // len(lanes)) + rng.uniform(0.0, 5.0), lane.centre.length - 4.0
        stations = _space_stations(min(begin, end - STEP_M), end)
        poses = [compute_lane_pose(lane, s, -(lane.width / 2 + RIDE_M)) for s in stations]
        speed, trigger = round(rng.uniform(2.0, 4.5), 2), TimeTrigger(at_s=round(rng.uniform(0.0, until_s / 2), 2))
        yield build_rider(f"cyclist{n}", BODIES["bicycle"], poses, speed, 0.0, trigger=trigger)
