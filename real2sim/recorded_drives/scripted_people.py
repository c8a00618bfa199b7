"""Pedestrians, cyclists and parked vehicles of a synthetic recording: scripted actors beside the lanes.

Pedestrians walk on pavements, stand at corners, and use crossings when lights allow it, or at any time without lights;
then they stand. Cyclists ride on cycle lanes.
"""

import math
import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle, islice, pairwise

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import build_polyline
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion, TimeTrigger
from mdrive_sumo.worlds.placement.bodies import BODIES, build_actor, build_parked_vehicle, build_rider
from mdrive_sumo.worlds.placement.lane_chains import build_pose
from mdrive_sumo.worlds.signalled_crossings import SignalledCrossing, find_signalled_crossings
from real2sim.recorded_drives.roadside_poses import (
    KerbSide,
    compute_cycling_pose,
    compute_walking_pose,
    find_kerb_sides,
)

STEP_M = 3.0
"""[m] Between points of a path."""
BAY_M = 6.8
"""[m] Kerb length per parked vehicle."""
LONGEST_WALK_M = 105.0
"""[m] Of the fastest walker, 1.9 m/s, during the longest drive, 55 s."""
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
    parked: int


def build_people(roads: RoadMap, count: PopulationCounts, until_s: float, rng: random.Random) -> tuple[Actor, ...]:
    """Build all of them; `until_s` [s] is the latest time at which a pedestrian begins to cross.

    Without cycle lanes there are no cyclists, and in few bays few vehicles park: as many more people walk.
    """
    sides = find_kerb_sides(roads)
    crossings = find_signalled_crossings(roads)
    parked = tuple(_build_parked(roads, count.parked, rng))
    cyclists = tuple(_build_cyclists([side for side in sides if side.can_cycle], count.cyclists, until_s, rng))
    walkers = count.walkers + count.parked - len(parked) + count.cyclists - len(cyclists)
    return (
        *(_build_walker(f"walker{n}", rng.choice(sides), rng) for n in range(walkers)),
        *(_build_waiting(f"waiting{n}", rng.choice(sides), rng) for n in range(count.waiting)),
        *(_build_crossing(f"crossing{n}", rng.choice(crossings), until_s, rng) for n in range(count.crossing)),
        *cyclists,
        *parked,
    )


def _build_walker(name: str, side: KerbSide, rng: random.Random) -> Actor:
    """Return a pedestrian who walks up and down; walking beyond the path would lead onto the road."""
    aside, speed = rng.uniform(-1.0, 1.0), round(rng.triangular(0.7, 1.9, 1.3), 2)
    begin, ends = rng.uniform(3.0, side.lane.centre.length - 3.0), (side.lane.centre.length - 1.0, 1.0)
    is_ahead = rng.random() < 0.5
    legs = math.ceil(LONGEST_WALK_M / (ends[0] - ends[1])) + 1
    turns = (begin, *islice(cycle(ends if is_ahead else ends[::-1]), legs))
    stations = [begin, *(s for pair in pairwise(turns) for s in _space_stations(*pair)[1:])]
    first, *others = (compute_walking_pose(side, s, aside) for s in stations)
    first = build_pose(first.x, first.y, first.yaw + (0.0 if is_ahead else math.pi))
    return build_rider(name, BODIES["adult"], (first, *others), speed)


def _space_stations(begin: float, end: float) -> list[float]:
    return np.linspace(begin, end, max(round(abs(end - begin) / STEP_M), 1) + 1).tolist()


def _build_waiting(name: str, side: KerbSide, rng: random.Random) -> Actor:
    """Return a standing pedestrian, most of them near a junction."""
    length_m = side.lane.centre.length
    s = min(rng.expovariate(0.1), length_m - 1.0)
    pose = compute_walking_pose(side, length_m - s if side.lane.successors else s, rng.uniform(-1.0, 1.0))
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


def _build_cyclists(sides: Sequence[KerbSide], count: int, until_s: float, rng: random.Random) -> Iterator[Actor]:
    for n in range(count if sides else 0):
        side = sides[n % len(sides)]
        begin, end = 4.0 + 10.0 * (n // len(sides)) + rng.uniform(0.0, 5.0), side.lane.centre.length - 4.0
        poses = [compute_cycling_pose(side, s) for s in _space_stations(min(begin, end - STEP_M), end)]
        speed, trigger = round(rng.uniform(2.0, 4.5), 2), TimeTrigger(at_s=round(rng.uniform(0.0, until_s / 2), 2))
        yield build_rider(f"cyclist{n}", BODIES["bicycle"], poses, speed, 0.0, trigger=trigger)


def _build_parked(roads: RoadMap, count: int, rng: random.Random) -> Iterator[Actor]:
    """Yield vehicles in the parking rows of the network."""
    rows = [build_polyline(row.xy) for row in roads.parking]
    bays = [(row, s) for row in rows for s in np.arange(BAY_M / 2, row.length - BAY_M / 2, BAY_M).tolist()]
    for n, k in enumerate(sorted(rng.sample(range(len(bays)), min(count, len(bays))))):
        row, s = bays[k]
        (x, y), yaw = row.at(s), row.yaw_at(s)
        model = "van" if rng.random() < VAN_SHARE else "car"
        yield build_parked_vehicle(f"parked{n}", model, build_pose(x, y, yaw), mirrored=False)
