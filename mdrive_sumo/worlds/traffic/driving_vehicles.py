"""Background vehicles that drive or queue at the start, and those that enter later."""

import math
import random
from collections.abc import Iterator

from mdrive_sumo.core import portable
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.worlds.traffic.lane_walk import Way, draw_way, find_entries
from mdrive_sumo.worlds.traffic.occupancy import TakenGround, build_lane_box
from mdrive_sumo.worlds.traffic.traffic_demand import TrafficDemand
from mdrive_sumo.worlds.traffic.vehicle_classes import LARGE, VEHICLE_CLASSES, build_vehicle

LEAST_HEADWAY_S = 1.8
"""[s] Least time between two vehicles of a stream: SUMO's drivers keep 1 s and 2.5 m, heavy ones 1.4 s."""
CRUISE_SHARE = 0.8
"""Speed at the start as a share of the limit: SUMO draws desired speeds from 0.8 to 1.2 of it, refuses more."""
STOP_DECEL, STOP_REACTION_S = 3.0, 1.2
"""[m/s2], [s] A vehicle starts so slowly that it can stop like this before the end of its lane: SUMO inserts none that
cannot stop before a junction that it may have to wait at."""
SUMO_GAP_M, SUMO_DECEL = 2.6, 4.5
"""[m], [m/s2] Least gap of SUMO's drivers, a little more, and their braking."""
LINE_M, FARTHEST_LINE_M = 0.25, 0.4
"""[m] Standard deviation of drivers' lines from the middle of the lane, and where it is cut, so that a vehicle stays in
a lane of 2.75 m: chosen. The logs of docs/traffic.md vary more."""
QUEUE_GAP_M = (2.6, 4.0)
"""[m] Gaps of a queue that stands: SUMO's drivers stop 2.5 m behind each other; more of them is chosen."""
QUEUE_END_M = (1.2, 2.5)
"""[m] Of the first vehicle of a queue from the end of its lane, the stop line."""
KEPT_FREE_S = 8.0
"""[s] Until then nothing enters where a stretch stays free: for an open door, longer than it takes to brake."""
FIRST_FRONT_M = 0.6
"""[m] Free length behind a vehicle that enters: its rear is on the lane, as SUMO wants it."""


STREET_MPS = 17.0
"""[m/s] Lanes with a higher limit (60 km/h) are no streets: nothing parks, delivers or cycles on them."""


def is_street(lane: Lane) -> bool:
    """Return whether a lane is one of a street of a town, outside junctions."""
    return not lane.junction and lane.speed_limit <= STREET_MPS


def draw_class(demand: TrafficDemand, rng: random.Random) -> str:
    """Return the name of a class."""
    return rng.choices(list(demand.classes), list(demand.classes.values()))[0]


def fit_class(name: str, way: Way) -> str:
    """Return the name of the class that drives a way: vans in the place of what is too large for it."""
    return "van" if name in LARGE and not way.fits_large else name


def draw_lane_offset(name: str, way: Way, rng: random.Random) -> float:
    """Return the line [m] on which a vehicle drives beside the middle of its lanes; large ones keep to the middle."""
    offset = min(max(rng.gauss(0.0, LINE_M), -FARTHEST_LINE_M), FARTHEST_LINE_M)
    return round(offset, 2) if fit_class(name, way) not in LARGE and way.keeps_lane else 0.0


def compute_start_speed(lane: Lane, room_m: float, top: float | None, ahead_mps: float = 0.0) -> float:
    """Return the speed [m/s] of a vehicle at the start, from which it can stop before what is ahead.

    room_m: to the end of its lane, or to the rear of the vehicle ahead, which drives at `ahead_mps`.
    """
    room = max(room_m - SUMO_GAP_M, 0.0) + ahead_mps * ahead_mps / (2 * SUMO_DECEL)
    braking = STOP_DECEL * (portable.hypot(STOP_REACTION_S, math.sqrt(2 * room / STOP_DECEL)) - STOP_REACTION_S)
    return round(max(min(CRUISE_SHARE * lane.speed_limit, braking, 0.95 * (top or math.inf)), 0.0), 2)


def draw_headway(demand: TrafficDemand, rng: random.Random) -> float:
    """Return a time [s] between two vehicles of a stream: the least one and an exponential rest."""
    return LEAST_HEADWAY_S + rng.expovariate(1.0 / max(3600.0 / demand.flow_per_lane - LEAST_HEADWAY_S, 0.05))


def draw_present(
    roads: RoadMap, demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[BackgroundVehicle]:
    """Return the vehicles that are on the road at the start: queues before junctions, and streams."""
    for lane in sorted(roads.driving, key=lambda one: one.id):
        if lane.junction:
            continue
        front = lane.centre.length
        if _may_have_to_wait(roads, lane) and rng.random() < demand.queue_share:
            queue = list(_draw_queue(roads, lane, demand, taken, rng))
            yield from queue
            if queue:
                front = queue[-1].depart_pos_m - queue[-1].length
        yield from _draw_stream(roads, lane, front, demand, taken, rng)


def _may_have_to_wait(roads: RoadMap, lane: Lane) -> bool:
    """Return whether a junction follows at which a queue can stand: one that offers more than one way."""
    return any(roads.lanes[id_].junction for id_ in lane.successors)


def _draw_queue(
    roads: RoadMap, lane: Lane, demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[BackgroundVehicle]:
    front = lane.centre.length - rng.uniform(*QUEUE_END_M)
    for _ in range(rng.randint(1, demand.longest_queue)):
        name = draw_class(demand, rng)
        vehicle = _place(roads, lane, name, front, 0.0, demand, taken, rng)
        if vehicle is None:
            return
        yield vehicle
        front -= vehicle.length + rng.uniform(*QUEUE_GAP_M)


def _draw_stream(
    roads: RoadMap, lane: Lane, end: float, demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[BackgroundVehicle]:
    """Return the vehicles that drive on a lane before `end` [m], from its end back."""
    cruise = CRUISE_SHARE * lane.speed_limit
    front, rear_ahead, ahead_mps = end - rng.random() * draw_headway(demand, rng) * cruise, end, 0.0
    while True:
        name = draw_class(demand, rng)
        kind = VEHICLE_CLASSES[name]
        if front < kind.length + FIRST_FRONT_M:
            return
        to_end = compute_start_speed(lane, lane.centre.length - front, kind.driving.max_speed)
        speed = min(to_end, compute_start_speed(lane, rear_ahead - front, None, ahead_mps))
        vehicle = _place(roads, lane, name, front, speed, demand, taken, rng)
        if vehicle is not None:
            yield vehicle
            rear_ahead, ahead_mps = front - kind.length, speed
        front -= kind.length + draw_headway(demand, rng) * cruise


def _place(
    roads: RoadMap,
    lane: Lane,
    name: str,
    front: float,
    speed: float,
    demand: TrafficDemand,
    taken: TakenGround,
    rng: random.Random,
) -> BackgroundVehicle | None:
    """Return a vehicle at a station [m] of a lane, whose place is taken then; None if it is not free."""
    kind = VEHICLE_CLASSES[name]
    if front < kind.length + FIRST_FRONT_M or taken.is_kept_free(lane.id, front - kind.length, front):
        return None
    box = build_lane_box(roads, lane.id, front, (kind.length, kind.width))
    if not taken.is_free(box):
        return None
    taken.take(box)
    way = draw_way(roads, lane.id, demand.turn_shares, rng)
    fields = {"depart_lane": lane.index, "depart_pos_m": round(front, 2), "depart_speed": speed}
    fields["lane_offset_m"] = draw_lane_offset(name, way, rng)
    return build_vehicle(fit_class(name, way), way.edges, keeps_lane=way.keeps_lane and is_street(lane), **fields)


def draw_entering(
    roads: RoadMap, demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[BackgroundVehicle]:
    """Return the vehicles that enter at the ends of the network until `entry_s`."""
    for id_ in find_entries(roads):
        lane = roads.lanes[id_]
        depart_s = rng.random() * draw_headway(demand, rng) + LEAST_HEADWAY_S
        while depart_s < demand.entry_s:
            name = draw_class(demand, rng)
            kind = VEHICLE_CLASSES[name]
            front = round(kind.length + FIRST_FRONT_M, 2)
            if front > lane.centre.length:
                break
            if depart_s < KEPT_FREE_S and taken.is_kept_free(id_, 0.0, front):
                depart_s += draw_headway(demand, rng)
                continue
            way = draw_way(roads, id_, demand.turn_shares, rng)
            speed = compute_start_speed(lane, lane.centre.length - front, kind.driving.max_speed)
            yield build_vehicle(
                fit_class(name, way),
                way.edges,
                depart_s=round(depart_s, 2),
                depart_lane=lane.index,
                depart_pos_m=front,
                depart_speed=min(speed, round(0.6 * lane.speed_limit, 2)),
                keeps_lane=way.keeps_lane and is_street(lane),
                lane_offset_m=draw_lane_offset(name, way, rng),
            )
            depart_s += draw_headway(demand, rng) + kind.length / 8.0
