"""Flows of reactive traffic along lanes of roads with high speeds, with given volumes."""

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import shapely

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor, LaneMotion, PathMotion
from mdrive_sumo.scenario.start_boxes import build_box, build_user_box
from mdrive_sumo.worlds.placement.background_vehicles import (
    FAST_DRIVING,
    build_background_vehicle,
    list_edges,
    number_vehicles,
)
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES
from mdrive_sumo.worlds.placement.lane_chains import Lanes, compute_pose

DEPART_SHARE = 0.8
"""Speed at departure as a share of the limit: SUMO draws the desired speeds of its drivers from 0.8 to 1.2 of it and
refuses a departure above."""
LEAST_HEADWAY_S = 1.6
"""[s] Least time between two vehicles of a stream."""
CLEAR_S = 1.0
"""[s] At the start no vehicle of a stream is within this time before or behind a CAV or moving actor on its lane."""
CLEAR_M = 7.0
"""[m] ... nor within this distance of its box."""
END_GAP_M = 40.0
"""[m] No vehicle starts this close to the end of a lane, where SUMO may have to brake it."""


@dataclass(frozen=True, slots=True)
class TrafficFlow:
    """A stream of vehicles along a chain of lanes without a lane change."""

    lanes: Lanes
    per_hour: float
    """Vehicles per hour."""
    models: Mapping[str, float]
    """Weights of models of `BODY_SIZES`."""
    is_entering: bool = False
    """Whether all enter later, behind what is on the road at the start."""


CARS: Mapping[str, float] = {"car": 0.85, "van": 0.15}
MIXED: Mapping[str, float] = {"car": 0.62, "van": 0.14, "truck": 0.24}
"""Weights of models by the kind of road: without heavy vehicles, and of a motorway by day; chosen."""


def build_flows(
    roads: RoadMap,
    flows: Sequence[TrafficFlow],
    seed: str,
    users: Sequence[Ego | Actor],
    duration_s: float = 25.0,
) -> tuple[BackgroundVehicle, ...]:
    """Return the vehicles of all flows: those on the road at the start, and those that enter within `duration_s`.

    None starts near one of `users`, or within `CLEAR_S` before or behind it.
    """
    blocked = shapely.union_all([build_user_box(user, 2 * (CLEAR_M + CLEAR_S * _get_speed(user))) for user in users])
    made: list[BackgroundVehicle] = []
    for number, flow in enumerate(flows):
        if flow.per_hour >= 1.0:
            rng = random.Random(f"{seed}/flow/{number}")
            made += [] if flow.is_entering else _find_present(roads, flow, rng, blocked)
            made += _find_entering(roads, flow, rng, duration_s)
    return number_vehicles(made)


def _get_speed(user: Ego | Actor) -> float:
    """Return the start speed [m/s]."""
    if isinstance(user, Ego):
        return user.start_speed
    return user.motion.start_speed if isinstance(user.motion, LaneMotion | PathMotion) else 0.0


def _draw_gap(flow: TrafficFlow, rng: random.Random) -> float:
    """Return a time headway [s] with the flow's mean."""
    return LEAST_HEADWAY_S + rng.expovariate(1.0 / max(3600.0 / flow.per_hour - LEAST_HEADWAY_S, 0.05))


def _draw_vehicle(roads: RoadMap, lane: str, flow: TrafficFlow, rng: random.Random) -> tuple[str, float]:
    """Return a model and its departure speed [m/s] on a lane."""
    model = rng.choices(list(flow.models), list(flow.models.values()))[0]
    top = FAST_DRIVING[model].max_speed or math.inf
    return model, round(min(DEPART_SHARE * roads.lanes[lane].speed_limit, 0.95 * top), 2)


def _find_present(
    roads: RoadMap, flow: TrafficFlow, rng: random.Random, blocked: shapely.Geometry
) -> Iterator[BackgroundVehicle]:
    for k, lane in enumerate(flow.lanes):
        if roads.lanes[lane].junction:
            continue
        front = roads.lanes[lane].centre.length - END_GAP_M * (k + 1 < len(flow.lanes))
        while True:
            model, speed = _draw_vehicle(roads, lane, flow, rng)
            length, width = BODY_SIZES[model]
            front -= _draw_gap(flow, rng) * speed + length
            if front < length + 1.0:
                break
            box = build_box(compute_pose(roads, (lane,), front - length / 2), length, width)
            if not box.intersects(blocked):
                yield _build_vehicle(roads, flow.lanes[k:], model, depart_pos_m=front, depart_speed=speed)


def _find_entering(
    roads: RoadMap, flow: TrafficFlow, rng: random.Random, duration_s: float
) -> Iterator[BackgroundVehicle]:
    depart_s = _draw_gap(flow, rng)
    while depart_s < duration_s:
        model, speed = _draw_vehicle(roads, flow.lanes[0], flow, rng)
        yield _build_vehicle(roads, flow.lanes, model, depart_s=depart_s, depart_speed=speed)
        depart_s += _draw_gap(flow, rng) + BODY_SIZES[model][0] / speed


def _build_vehicle(roads: RoadMap, lanes: Lanes, model: str, **departure: float) -> BackgroundVehicle:
    index = roads.lanes[lanes[0]].index
    return build_background_vehicle(model, list_edges(roads, lanes), index, FAST_DRIVING[model], **departure)
