"""Pedestrians, cyclists and parked vehicles: scripted actors beside the lanes, drawn at random.

Pedestrians walk on pavements, stand at corners, and use crossings when lights allow it, or at any time without lights;
then they stand. Cyclists ride along kerbs without parked vehicles.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.props import PROPS
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, PathMotion, ReplayMotion, StandingMotion, TimeTrigger
from tools.synthetic_recordings.roadside_poses import (
    RoadsidePose,
    SignalledCrossing,
    compute_cycling_pose,
    compute_parking_pose,
    compute_walking_pose,
    find_crossings,
    find_kerb_lanes,
)

STEP_M = 3.0
"""[m] Between points of a path."""
BOX_M = {"pedestrian": (0.5, 0.6), "cyclist": (1.8, 0.6)}
"""[m] Length and width."""
BAY_M = 6.8
"""[m] Kerb length per parked vehicle."""
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
    parked: int


def build_people(
    roads: RoadMap, count: PopulationCounts, until_s: float, rng: np.random.Generator
) -> tuple[Actor, ...]:
    """Build all of them; `until_s` [s] is the latest time at which a pedestrian begins to cross."""
    lanes = find_kerb_lanes(roads)
    strips = {lanes[i].id for i in rng.choice(len(lanes), size=max(len(lanes) // 4, 2), replace=False).tolist()}
    return (
        *_build_walkers(lanes, count.walkers, rng),
        *_build_waiting(lanes, count.waiting, rng),
        *_build_crossing(find_crossings(roads), count.crossing, until_s, rng),
        *_build_cyclists([lane for lane in lanes if lane.id in strips], count.cyclists, until_s, rng),
        *_build_parked([lane for lane in lanes if lane.id not in strips], count.parked, rng),
    )


def _build_moving_actor(
    name: str, kind: str, places: Sequence[RoadsidePose], speed: float, start_s: float | None = None
) -> Actor:
    """Build an actor on a path that moves from the start or from a given time."""
    x, y, yaw = places[0]
    length, width = BOX_M[kind]
    return Actor.model_validate(
        {
            "id": name,
            "kind": kind,
            "length": length,
            "width": width,
            "start": Pose(x=x, y=y, yaw=yaw),
            "motion": PathMotion(
                points=tuple(place[:2] for place in places), speed=speed, start_speed=speed if start_s is None else 0.0
            ),
            "trigger": None if start_s is None else TimeTrigger(at_s=start_s),
        }
    )


def _build_walkers(lanes: Sequence[Lane], count: int, rng: np.random.Generator) -> Iterator[Actor]:
    for n in range(count):
        lane = lanes[int(rng.integers(len(lanes)))]
        aside = float(rng.uniform(-1.0, 1.0))
        speed = round(float(np.clip(rng.normal(1.3, 0.2), 0.7, 1.9)), 2)
        begin = float(rng.uniform(3.0, lane.centre.length - 3.0))
        ahead = bool(rng.random() < 0.5)
        ends = (lane.centre.length - 1.0, 1.0) if ahead else (1.0, lane.centre.length - 1.0)
        stations = [begin, *_compute_stations(begin, *ends, ends[0])]
        places = [compute_walking_pose(lane, s, aside) for s in stations]
        yaw = places[0][2] + (0.0 if ahead else np.pi)
        yield _build_moving_actor(
            f"walker{n}", "pedestrian", [(*places[0][:2], round(float(yaw), 4)), *places[1:]], speed
        )


def _compute_stations(*turns: float) -> list[float]:
    """Return stations from the first turning point to the last; walking beyond the path would lead onto the road."""
    return [s for begin, end in pairwise(turns) for s in _space_stations(begin, end)[1:]]


def _space_stations(begin: float, end: float) -> list[float]:
    return np.linspace(begin, end, max(round(abs(end - begin) / STEP_M), 1) + 1).tolist()


def _build_waiting(lanes: Sequence[Lane], count: int, rng: np.random.Generator) -> Iterator[Actor]:
    """Yield standing pedestrians, most of them near a junction."""
    for n in range(count):
        lane = lanes[int(rng.integers(len(lanes)))]
        s = min(float(rng.exponential(10.0)), lane.centre.length - 1.0)
        place = compute_walking_pose(
            lane, lane.centre.length - s if lane.successors else s, float(rng.uniform(-1.0, 1.0))
        )
        x, y, _ = place
        length, width = BOX_M["pedestrian"]
        pose = Pose(x=x, y=y, yaw=round(float(rng.uniform(-np.pi, np.pi)), 4))
        yield Actor(
            id=f"waiting{n}", kind="pedestrian", length=length, width=width, start=pose, motion=StandingMotion()
        )


def _build_crossing(
    ways: Sequence[SignalledCrossing], count: int, until_s: float, rng: np.random.Generator
) -> Iterator[Actor]:
    for n in range(count):
        zebra = ways[int(rng.integers(len(ways)))]
        line = zebra.line[::-1] if rng.random() < 0.5 else zebra.line
        ahead = (line[1] - line[0]) / float(np.hypot(*(line[1] - line[0])))
        aside = float(rng.uniform(-1.3, 1.3)) * np.array((-ahead[1], ahead[0]))
        points = np.round([line[0] - WAIT_M * ahead + aside, line[1] + BEYOND_M * ahead + aside], 3)
        yaw = round(float(np.arctan2(ahead[1], ahead[0])), 4)
        speed = float(np.clip(rng.normal(1.4, 0.15), 1.0, 1.9))
        begin = _draw_crossing_time(zebra, until_s, rng)
        end = round(begin + float(np.hypot(*(points[1] - points[0]))) / speed, 2)
        poses = [(t, float(x), float(y), yaw) for t, (x, y) in ((0.0, points[0]), (begin, points[0]), (end, points[1]))]
        length, width = BOX_M["pedestrian"]
        yield Actor(
            id=f"crossing{n}",
            kind="pedestrian",
            length=length,
            width=width,
            start=Pose(x=poses[0][1], y=poses[0][2], yaw=yaw),
            motion=ReplayMotion(poses=tuple(poses), stays=True),
        )


def _draw_crossing_time(zebra: SignalledCrossing, until_s: float, rng: np.random.Generator) -> float:
    """Draw a time within the first two thirds of a green interval, or any time."""
    if not zebra.green:
        return round(float(rng.uniform(0.05, until_s)), 2)
    cycles = range(int(until_s // zebra.cycle_s) + 1)
    starts = [(begin + k * zebra.cycle_s, end - begin) for k in cycles for begin, end in zebra.green]
    begin, length = starts[int(rng.integers(len(starts)))]
    return round(begin + float(rng.uniform(0.05, length * 2 / 3)), 2)


def _build_cyclists(lanes: Sequence[Lane], count: int, until_s: float, rng: np.random.Generator) -> Iterator[Actor]:
    for n in range(count):
        lane = lanes[n % len(lanes)]
        begin = 4.0 + 10.0 * (n // len(lanes)) + float(rng.uniform(0.0, 5.0))
        end = lane.centre.length - 4.0
        places = [compute_cycling_pose(lane, s) for s in _space_stations(min(begin, end - STEP_M), end)]
        speed, start_s = round(float(rng.uniform(2.0, 4.5)), 2), round(float(rng.uniform(0.0, until_s / 2)), 2)
        yield _build_moving_actor(f"cyclist{n}", "cyclist", places, speed, start_s)


def _build_parked(lanes: Sequence[Lane], count: int, rng: np.random.Generator) -> Iterator[Actor]:
    bays = [(lane, s) for lane in lanes for s in np.arange(CLEAR_M, lane.centre.length - CLEAR_M, BAY_M).tolist()]
    chosen = sorted(rng.choice(len(bays), size=min(count, len(bays)), replace=False).tolist())
    for n, k in enumerate(chosen):
        lane, s = bays[k]
        prop = PROPS["parked-van" if rng.random() < VAN_SHARE else "parked-car"]
        x, y, yaw = compute_parking_pose(lane, s + float(rng.uniform(-0.3, 0.3)))
        length = round(prop.length * float(rng.uniform(0.9, 1.05)), 2)
        yield Actor(id=f"parked{n}", kind=prop.kind, length=length, width=prop.width, start=Pose(x=x, y=y, yaw=yaw))
