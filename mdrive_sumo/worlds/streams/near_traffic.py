"""Background vehicles around the CAVs of a scenario: near them, in a queue ahead of one, and entering later."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import shapely

from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import CAR
from mdrive_sumo.worlds.lane_routes import find_lane_routes
from mdrive_sumo.worlds.placement.background_vehicles import (
    DRIVING,
    build_background_vehicle,
    find_continuations,
    number_vehicles,
)
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES
from mdrive_sumo.worlds.placement.occupancy import (
    Occupancy,
    build_box_behind,
    build_occupancy,
    build_start_area,
    select_lanes_near,
)

START_NEAR_CAV_M = 75.0
"""[m] Vehicles start within this distance of a CAV."""
FREE_M, JAM_M = 9.0, 3.0
"""[m] Least gap along a lane to what is there at the start; in a jam."""
BESIDE_M = 0.5
"""[m] Least distance between boxes of different lanes."""
SPEED_BY_GAP = 0.3
"""[1/s] Speed at the start as a share of the gap ahead and of the way to the lane's end: SUMO inserts nothing that
would have to brake hard."""
TOP_MPS = (7.0, 13.0)
"""[m/s] Drawn once for all vehicles of a scenario, so that they do not catch up with CAVs of 8 m/s too fast."""
TOP_SHARES = (0.85, 1.05)
"""The same as a share of the greatest speed limit, around CAVs that drive as fast as the road allows; chosen."""
ENTER_S = (1.0, 20.0)
"""[s] When vehicles enter that are not there at the start."""
PRESENT_SHARE = 0.75
"""Share of the vehicles that are there at the start; the others enter within `ENTER_S`."""
TRIES = 12
"""Places that are tried for one vehicle."""


@dataclass(frozen=True, slots=True)
class TrafficRequest:
    """How many background vehicles a scenario shall have."""

    queue: int
    """Standing ahead of the first CAV."""
    others: int
    is_jammed: bool = False
    at_road_speed: bool = False
    """Whether they drive as fast as the road allows, as the CAVs do."""


def build_near_traffic(
    roads: RoadMap, egos: Sequence[Ego], actors: Sequence[Actor], request: TrafficRequest, rng: random.Random
) -> tuple[BackgroundVehicle, ...]:
    """Return background vehicles; fewer than requested where there is no room."""
    taken = build_occupancy((*egos, *actors), (), roads)
    fastest = max(lane.speed_limit for lane in roads.driving)
    top = rng.uniform(*TOP_SHARES) * fastest if request.at_road_speed else rng.uniform(*TOP_MPS)
    made = list(_build_queue(roads, egos[0], request.queue, taken, rng)) if request.queue else []
    present = round(request.others * PRESENT_SHARE)
    made += _build_present(roads, egos, (present, request.is_jammed, top), taken, rng)
    made += _build_entering(roads, request.others - present, top, rng)
    return number_vehicles(made)


def _draw_model(rng: random.Random) -> str:
    return rng.choices(("car", "van", "truck", "bus"), (0.76, 0.14, 0.06, 0.04))[0]


def _build_vehicle(
    model: str, edges: tuple[str, ...], lane: Lane, place: tuple[float, float, float], top: float
) -> BackgroundVehicle:
    """Return a vehicle; `place`: departure time [s], position of its front [m], speed [m/s]."""
    driving = DRIVING[model].model_copy(update={"max_speed": round(top, 2)})
    departure = dict(zip(("depart_s", "depart_pos_m", "depart_speed"), place, strict=True))
    return build_background_vehicle(model, edges, lane.index, driving, **departure)


def _build_queue(
    roads: RoadMap, ego: Ego, count: int, taken: Occupancy, rng: random.Random
) -> Iterator[BackgroundVehicle]:
    """Return vehicles that stand on the CAV's first lane ahead of it, and drive on where it does."""
    lane = roads.lanes[ego.lanes[0]]
    if lane.junction or lane.id not in find_continuations(roads):
        return
    edges = rng.choice(find_continuations(roads)[lane.id])
    begin = lane.centre.project(ego.start.x, ego.start.y)[0]
    rear = begin + CAR.length / 2 + rng.uniform(8.0, 22.0)
    for _ in range(count):
        model = _draw_model(rng)
        front = rear + BODY_SIZES[model][0]
        box = build_box_behind(lane, min(front, lane.centre.length), BODY_SIZES[model])
        if front > lane.centre.length - 1.0 or not taken.is_free(box, 1.0):
            return
        taken.boxes.append(box)
        yield _build_vehicle(model, edges, lane, (0.0, front, 0.0), 8.0)
        rear = front + rng.uniform(2.0, 4.0)


@dataclass(frozen=True, slots=True)
class _Place:
    """A place on a lane that a vehicle takes at the start."""

    model: str
    lane: Lane
    front_m: float
    """Position of the front bumper on the lane."""

    @property
    def length_m(self) -> float:
        return BODY_SIZES[self.model][0]


def _build_present(
    roads: RoadMap,
    egos: Sequence[Ego],
    wanted: tuple[int, bool, float],
    taken: Occupancy,
    rng: random.Random,
) -> Iterator[BackgroundVehicle]:
    """Return vehicles that are on the road at the start; `wanted`: how many, whether jammed, top speed [m/s]."""
    count, is_jammed, top = wanted
    area = None if is_jammed else build_start_area(egos, START_NEAR_CAV_M)
    lanes = [roads.lanes[name] for name in find_continuations(roads)]
    lanes = lanes if is_jammed else select_lanes_near(lanes, egos, START_NEAR_CAV_M)
    drawn = (_draw_place(lanes, area, JAM_M if is_jammed else FREE_M, taken, rng) for _ in range(count if lanes else 0))
    for place in [place for place in drawn if place is not None]:  # all have their places before any has a speed
        gap = min(
            taken.find_gaps(place.lane, place.front_m, place.length_m)[0], place.lane.centre.length - place.front_m
        )
        speed = min(0.6 * place.lane.speed_limit, 0.8 * top, SPEED_BY_GAP * max(gap, 0.0))
        edges = rng.choice(find_continuations(roads)[place.lane.id])
        yield _build_vehicle(place.model, edges, place.lane, (0.0, place.front_m, speed), top)


def _draw_place(
    lanes: Sequence[Lane], area: shapely.Geometry | None, gap_m: float, taken: Occupancy, rng: random.Random
) -> _Place | None:
    """Return a free place, which is taken then; None if none was found. area: where its box must be, if given."""
    for _ in range(TRIES):
        lane, model = rng.choices(lanes, [lane.centre.length for lane in lanes])[0], _draw_model(rng)
        length = BODY_SIZES[model][0]
        front = round(rng.uniform(length + 0.5, max(lane.centre.length - 1.0, length + 1.0)), 2)
        if front > lane.centre.length:
            continue
        place, box = _Place(model, lane, front), build_box_behind(lane, front, BODY_SIZES[model])
        is_near = area is None or bool(shapely.intersects(area, box))
        if is_near and taken.is_free(box, BESIDE_M) and min(taken.find_gaps(lane, front, length)) >= gap_m:
            taken.boxes.append(box)
            return place
    return None


def _build_entering(roads: RoadMap, count: int, top: float, rng: random.Random) -> list[BackgroundVehicle]:
    """Return vehicles that enter at the ends of the network, three seconds apart on a lane."""
    entries = sorted({way.lanes[0] for way in find_lane_routes(roads)})
    free_s = dict.fromkeys(entries, ENTER_S[0])
    made: list[BackgroundVehicle] = []
    for _ in range(count):
        lane = roads.lanes[rng.choice(entries)]
        depart_s = max(rng.uniform(*ENTER_S), free_s[lane.id])
        free_s[lane.id] = depart_s + 3.0
        model, edges = _draw_model(rng), rng.choice(find_continuations(roads)[lane.id])
        speed = min(0.6 * lane.speed_limit, 0.8 * top)
        made.append(_build_vehicle(model, edges, lane, (depart_s, BODY_SIZES[model][0] + 0.5, speed), top))
    return sorted(made, key=lambda one: (one.depart_s, one.edges))
