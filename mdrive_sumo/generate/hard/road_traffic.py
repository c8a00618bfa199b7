"""Reactive traffic on roads with high speeds: streams with given flows, and platoons of CAVs between them."""

import math
import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import shapely

from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.generate.hard.family_parts import BODY_SIZES, Lanes, RouteLaneChange, build_changing_cav, compute_pose
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor, LaneMotion, PathMotion

MODEL_SIZES: Mapping[str, tuple[float, float]] = {**BODY_SIZES, "ambulance": (6.2, 2.1)}
"""Length and width [m] of vehicles by model; the ambulance is that of EN 1789, type C, rounded."""
CAR_M = 4.9
"""[m] Length of a CAV."""
DRIVING: Mapping[str, CarFollowing] = {
    "car": CarFollowing(sigma=0.2),
    "van": CarFollowing(sigma=0.2, accel=2.0, max_speed=30.0),
    "truck": CarFollowing(sigma=0.2, accel=1.2, decel=4.0, tau_s=1.4, max_speed=24.0),
}
"""Trucks are governed at 86 to 90 km/h (EU directive 92/6/EEC), vans without a limiter; the rest are assumptions."""
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


def build_flows(
    roads: RoadMap,
    flows: Sequence[TrafficFlow],
    seed: str,
    egos: Sequence[Ego],
    actors: Sequence[Actor] = (),
    duration_s: float = 25.0,
) -> tuple[BackgroundVehicle, ...]:
    """Return the vehicles of all flows: those on the road at the start, and those that enter within `duration_s`."""
    blocked = _build_blocked_area(egos, actors)
    made: list[BackgroundVehicle] = []
    for number, flow in enumerate(flows):
        if flow.per_hour >= 1.0:
            rng = random.Random(f"{seed}/flow/{number}")
            made += [] if flow.is_entering else _find_present(roads, flow, rng, blocked)
            made += _find_entering(roads, flow, rng, duration_s)
    return tuple(vehicle.model_copy(update={"id": f"bg{i}"}) for i, vehicle in enumerate(made))


def _build_blocked_area(egos: Sequence[Ego], actors: Sequence[Actor]) -> shapely.Geometry:
    """Return the area in which no vehicle starts: around CAVs and actors, and `CLEAR_S` before and behind them."""
    boxes = [(e.start, CAR_M, 2.0, e.start_speed) for e in egos]
    boxes += [(a.start, a.length, a.width, _find_speed(a)) for a in actors]
    return shapely.union_all(
        [
            shapely.Polygon(box_corners(at.x, at.y, at.yaw, length + 2 * (CLEAR_M + CLEAR_S * speed), width))
            for at, length, width, speed in boxes
        ]
    )


def _find_speed(actor: Actor) -> float:
    """Return the start speed [m/s] of an actor."""
    return actor.motion.start_speed if isinstance(actor.motion, LaneMotion | PathMotion) else 0.0


def _draw_gap(flow: TrafficFlow, rng: random.Random) -> float:
    """Return a time headway [s] with the flow's mean."""
    return LEAST_HEADWAY_S + rng.expovariate(1.0 / max(3600.0 / flow.per_hour - LEAST_HEADWAY_S, 0.05))


def _draw_vehicle(roads: RoadMap, lane: str, flow: TrafficFlow, rng: random.Random) -> tuple[str, float]:
    """Return a model and its departure speed [m/s] on a lane."""
    model = rng.choices(list(flow.models), list(flow.models.values()))[0]
    top = DRIVING[model].max_speed or math.inf
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
            pose = compute_pose(roads, (lane,), front - length / 2)
            box = shapely.Polygon(box_corners(pose.x, pose.y, pose.yaw, length, width))
            if not box.intersects(blocked):
                yield _build_vehicle(roads, flow.lanes[k:], model, 0.0, front, speed)


def _find_entering(
    roads: RoadMap, flow: TrafficFlow, rng: random.Random, duration_s: float
) -> Iterator[BackgroundVehicle]:
    depart_s = _draw_gap(flow, rng)
    while depart_s < duration_s:
        model, speed = _draw_vehicle(roads, flow.lanes[0], flow, rng)
        yield _build_vehicle(roads, flow.lanes, model, depart_s, BODY_SIZES[model][0] + 0.5, speed)
        depart_s += _draw_gap(flow, rng) + BODY_SIZES[model][0] / speed


def _build_vehicle(
    roads: RoadMap, lanes: Lanes, model: str, depart_s: float, front_m: float, speed: float
) -> BackgroundVehicle:
    length, width = BODY_SIZES[model]
    ways = [roads.lanes[lane] for lane in lanes if not roads.lanes[lane].junction]
    return BackgroundVehicle(
        id="bg",
        depart_s=round(depart_s, 2),
        edges=tuple(dict.fromkeys(way.edge for way in ways)),
        depart_lane=ways[0].index,
        depart_pos_m=round(front_m, 2),
        depart_speed=speed,
        length=length,
        width=width,
        driving=DRIVING[model],
    )


@dataclass(frozen=True, slots=True)
class Platoon:
    """CAVs one behind the other along a chain of lanes."""

    lanes: Lanes
    count: int
    lead_m: float
    """Station [m] of the first CAV."""
    goal_m: float
    speed: float
    headway_s: float
    """[s] Between rear and front bumper of two CAVs."""
    change: RouteLaneChange | None = None


def build_platoons(roads: RoadMap, platoons: Sequence[Platoon]) -> tuple[Ego, ...]:
    """Return the CAVs of all platoons, with ids "0", "1", ... in their order. Raises ProposalRejected."""
    made: list[Ego] = []
    for one in platoons:
        for k in range(one.count):
            start = one.lead_m - k * (CAR_M + max(one.headway_s * one.speed, 3.0))
            way, drive = (one.lanes, one.change), (start, one.goal_m)
            made.append(build_changing_cav(roads, str(len(made)), way, drive, one.speed))
    return tuple(made)


def build_moving_actor(
    name: str, model: str, roads: RoadMap, lanes: Lanes, start: tuple[float, float], **more: object
) -> Actor:
    """Return a vehicle of a model of `MODEL_SIZES` that drives along lanes; `more`: further fields of `Actor`.

    start: station [m] on the chain, at which it begins, and its speed [m/s]; with a trigger it stands until then.
    """
    station, speed = start
    length, width = MODEL_SIZES[model]
    motion = LaneMotion(lanes=lanes, speed=round(speed, 2), start_speed=0.0 if "trigger" in more else round(speed, 2))
    size = {"length": length, "width": width}
    fields = {"id": name, "kind": "vehicle", "model": model, "motion": motion, **size, **more}
    return Actor.model_validate({**fields, "start": compute_pose(roads, lanes, station)})
