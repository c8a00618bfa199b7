"""Traffic of the hard tier's families: reactive streams, standing queues and rows of parked vehicles."""

import random
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import shapely

from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.generate.hard.family_parts import BODY_SIZES, Lanes, build_vehicle_actor, compute_pose
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.vehicle import dynamics

CAR = dynamics.MKZ_2017
MOVING_GAP_M = (16.0, 40.0)
"""[m] Gaps between vehicles that are on the road at the start and drive."""
DEPART_SPEED_SHARE = 0.6
"""Speed of vehicles at departure as a share of the speed limit: SUMO inserts nothing that would have to brake hard."""
END_GAP_M = 45.0
"""[m] No vehicle starts to drive this close to the end of a lane: it may have to stop there."""
KEEP_CLEAR_M = 14.0
"""[m] Traffic starts at least this far from CAVs and standing actors."""
LEAST_HEADWAY_S = 1.8
"""[s] Between two departures on one lane."""
ENTRY_S = 40.0
"""Vehicles enter until then: longer than an episode needs."""
MEAN_EXTRA_HEADWAY_S = 2.0
"""[s] Mean of the drawn time beyond that."""
DRIVING: Mapping[str, CarFollowing] = {
    "car": CarFollowing(sigma=0.2),
    "van": CarFollowing(sigma=0.2, accel=2.0),
    "truck": CarFollowing(sigma=0.2, accel=1.2, decel=4.0, tau_s=1.3),
    "bus": CarFollowing(sigma=0.2, accel=1.2, decel=4.0, tau_s=1.3),
}
"""Heavy vehicles accelerate less. Drivers are more even than SUMO's (sigma 0.5): less of the outcome is chance."""


@dataclass(frozen=True, slots=True)
class TrafficStream:
    """A route of reactive traffic through a network."""

    edges: tuple[str, ...]
    lanes: tuple[int, ...]
    """SUMO indices of the lanes of the first edge on which it departs."""
    share: float = 1.0
    """Its weight among the streams."""
    large: bool = True
    """Whether buses and trucks drive it; boxes of long vehicles cut corners."""


def build_traffic(
    roads: RoadMap,
    streams: Sequence[TrafficStream],
    count: int,
    seed: str,
    keep_clear: Sequence[Ego | Actor] = (),
) -> tuple[BackgroundVehicle, ...]:
    """Return `count` reactive vehicles of mixed sizes: as many as have room drive at the start, others enter later.

    None starts close to a CAV or actor of `keep_clear`. Fewer if the streams' entries cannot take them in `ENTRY_S`.
    """
    rng = random.Random(f"{seed}/traffic")
    blocked = _build_blocked_area(keep_clear)
    present = list(_find_starts(roads, streams, rng, blocked))
    rng.shuffle(present)
    starts = sorted(present[: round(count * 0.7)], key=lambda one: (one.edges, one.depart_lane, one.depart_pos_m))
    entering = _build_entering(roads, streams, count - len(starts), rng)
    return tuple(vehicle.model_copy(update={"id": f"bg{i}"}) for i, vehicle in enumerate((*starts, *entering)))


def _build_blocked_area(users: Sequence[Ego | Actor]) -> shapely.Geometry:
    sizes = [(user.length, user.width) if isinstance(user, Actor) else (CAR.length, CAR.width) for user in users]
    return shapely.union_all(
        [
            shapely.Polygon(box_corners(user.start.x, user.start.y, user.start.yaw, *size))
            for user, size in zip(users, sizes, strict=True)
        ]
    )


def _draw_model(stream: TrafficStream, rng: random.Random) -> str:
    if not stream.large:
        return rng.choices(("car", "van"), (0.8, 0.2))[0]
    return rng.choices(("car", "van", "truck", "bus"), (0.66, 0.16, 0.1, 0.08))[0]


def _build_background_vehicle(model: str, edges: tuple[str, ...], **fields: float) -> BackgroundVehicle:
    length, width = BODY_SIZES[model]
    return BackgroundVehicle.model_validate(
        {"id": "bg", "edges": edges, "length": length, "width": width, "driving": DRIVING[model], **fields}
    )


def _find_starts(
    roads: RoadMap, streams: Sequence[TrafficStream], rng: random.Random, blocked: shapely.Geometry
) -> Iterator[BackgroundVehicle]:
    """Return vehicles on all free places of the streams' edges, each place once."""
    used: set[str] = set()
    for stream in streams:
        for k in range(len(stream.edges) - 1):
            for lane in _find_edge_lanes(roads, stream, k):
                if lane not in used and rng.random() < stream.share:
                    used.add(lane)
                    yield from _fill_lane(roads, lane, (stream, stream.edges[k:]), rng, blocked)


def _find_edge_lanes(roads: RoadMap, stream: TrafficStream, k: int) -> list[str]:
    """Return the lanes of the stream's edge k from which its next edge is reached without a lane change."""
    if k == 0:
        return [f"{stream.edges[0]}_{index}" for index in stream.lanes]
    return sorted(
        lane.id
        for lane in roads.driving
        if lane.edge == stream.edges[k] and stream.edges[k + 1] in _find_next_edges(roads, lane)
    )


def _find_next_edges(roads: RoadMap, lane: Lane) -> set[str]:
    """Return the edges that a lane leads to, past the lanes inside the junction."""
    edges, ahead = set[str](), list(lane.successors)
    while ahead:
        there = roads.lanes[ahead.pop()]
        if there.junction:
            ahead.extend(there.successors)
        else:
            edges.add(there.edge)
    return edges


def _fill_lane(
    roads: RoadMap,
    lane_id: str,
    way: tuple[TrafficStream, tuple[str, ...]],
    rng: random.Random,
    blocked: shapely.Geometry,
) -> Iterator[BackgroundVehicle]:
    lane, (stream, edges) = roads.lanes[lane_id], way
    front = lane.centre.length - END_GAP_M - rng.uniform(0.0, 10.0)
    while front > 15.0:
        model = _draw_model(stream, rng)
        length, width = BODY_SIZES[model]
        middle = compute_pose(roads, (lane_id,), front - length / 2)
        box = shapely.Polygon(box_corners(middle.x, middle.y, middle.yaw, length, width))
        if front > length + 1.0 and box.distance(blocked) > KEEP_CLEAR_M:
            speed = round(lane.speed_limit * DEPART_SPEED_SHARE, 2)
            yield _build_background_vehicle(
                model, edges, depart_s=0.0, depart_lane=lane.index, depart_pos_m=round(front, 2), depart_speed=speed
            )
        front -= length + rng.uniform(*MOVING_GAP_M)


def _build_entering(
    roads: RoadMap, streams: Sequence[TrafficStream], count: int, rng: random.Random
) -> list[BackgroundVehicle]:
    """Return vehicles that enter on the streams' first edges, sorted by time, `LEAST_HEADWAY_S` apart on a lane."""
    gates = [(stream, index) for stream in streams for index in stream.lanes]
    free_s = dict.fromkeys((f"{stream.edges[0]}_{index}" for stream, index in gates), 2.0)
    made: list[BackgroundVehicle] = []
    for _ in range(count):
        stream, index = rng.choices(gates, [stream.share / len(stream.lanes) for stream, _ in gates])[0]
        lane = f"{stream.edges[0]}_{index}"
        model = _draw_model(stream, rng)
        depart_s = free_s[lane] + rng.expovariate(1.0 / MEAN_EXTRA_HEADWAY_S)
        free_s[lane] = depart_s + LEAST_HEADWAY_S + BODY_SIZES[model][0] / 8.0
        if depart_s < ENTRY_S:
            speed = round(roads.lanes[lane].speed_limit * DEPART_SPEED_SHARE, 2)
            front = BODY_SIZES[model][0] + 0.5
            gate = {"depart_s": round(depart_s, 2), "depart_lane": index, "depart_pos_m": front}
            made.append(_build_background_vehicle(model, stream.edges, depart_speed=speed, **gate))
    return sorted(made, key=lambda one: (one.depart_s, one.edges))


def build_standing_queue(
    roads: RoadMap, lane: str, edges: tuple[str, ...], models: Sequence[str], end_gap_m: float, prefix: str
) -> tuple[BackgroundVehicle, ...]:
    """Return a queue of reactive vehicles that stand at the start, the first `end_gap_m` before the lane's end."""
    front, made = roads.lanes[lane].centre.length - end_gap_m, list[BackgroundVehicle]()
    for i, model in enumerate(models):
        length = BODY_SIZES[model][0]
        if front < length + 1.0:
            break
        vehicle = _build_background_vehicle(
            model, edges, depart_s=0.0, depart_lane=roads.lanes[lane].index, depart_pos_m=round(front, 2)
        )
        made.append(vehicle.model_copy(update={"id": f"{prefix}{i}"}))
        front -= length + 3.0
    return tuple(made)


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
            made.append(build_vehicle_actor(f"{prefix}{len(made)}", model, pose, mirrored=False))
        end -= length + gap
