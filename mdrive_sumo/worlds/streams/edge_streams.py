"""Streams of reactive traffic along edges, of mixed sizes: on the road at the start and entering later; queues."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import shapely

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scripted_actor import Actor
from mdrive_sumo.scenario.start_boxes import build_box, build_user_box
from mdrive_sumo.worlds.placement.background_vehicles import (
    build_background_vehicle,
    find_next_edges,
    number_vehicles,
)
from mdrive_sumo.worlds.placement.bodies import BODY_SIZES, space_vehicles
from mdrive_sumo.worlds.placement.lane_chains import compute_pose

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
PRESENT_SHARE = 0.7
"""Share of the vehicles that are on the road at the start, where they have room."""
QUEUE_GAP_M = 3.0
"""[m] Between vehicles of a standing queue; SUMO's drivers keep 2.5 m."""


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
    blocked = shapely.union_all([build_user_box(user) for user in keep_clear])
    present = list(_find_starts(roads, streams, rng, blocked))
    rng.shuffle(present)
    present = present[: round(count * PRESENT_SHARE)]
    starts = sorted(present, key=lambda one: (one.edges, one.depart_lane, one.depart_pos_m))
    return number_vehicles([*starts, *_build_entering(roads, streams, count - len(starts), rng)])


def _draw_model(stream: TrafficStream, rng: random.Random) -> str:
    if not stream.large:
        return rng.choices(("car", "van"), (0.8, 0.2))[0]
    return rng.choices(("car", "van", "truck", "bus"), (0.66, 0.16, 0.1, 0.08))[0]


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
        if lane.edge == stream.edges[k] and stream.edges[k + 1] in find_next_edges(roads, lane.id)
    )


def _fill_lane(
    roads: RoadMap,
    lane_id: str,
    way: tuple[TrafficStream, tuple[str, ...]],
    rng: random.Random,
    blocked: shapely.Geometry,
) -> Iterator[BackgroundVehicle]:
    lane, (stream, edges) = roads.lanes[lane_id], way
    front = lane.centre.length - END_GAP_M - rng.uniform(0.0, 10.0)
    speed = lane.speed_limit * DEPART_SPEED_SHARE
    while front > 15.0:
        model = _draw_model(stream, rng)
        length, width = BODY_SIZES[model]
        box = build_box(compute_pose(roads, (lane_id,), front - length / 2), length, width)
        if front > length + 1.0 and box.distance(blocked) > KEEP_CLEAR_M:
            yield build_background_vehicle(model, edges, lane.index, depart_pos_m=front, depart_speed=speed)
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
            speed = roads.lanes[lane].speed_limit * DEPART_SPEED_SHARE
            made.append(build_background_vehicle(model, stream.edges, index, depart_s=depart_s, depart_speed=speed))
    return sorted(made, key=lambda one: (one.depart_s, one.edges))


def build_standing_queue(
    roads: RoadMap, lane: str, edges: tuple[str, ...], models: Sequence[str], end_gap_m: float, prefix: str
) -> tuple[BackgroundVehicle, ...]:
    """Return a queue of reactive vehicles that stand at the start, the first `end_gap_m` before the lane's end."""
    made: list[BackgroundVehicle] = []
    for model, middle in space_vehicles(models, roads.lanes[lane].centre.length - end_gap_m, QUEUE_GAP_M):
        front = middle + BODY_SIZES[model][0] / 2
        if front < BODY_SIZES[model][0] + 1.0:
            break
        made.append(build_background_vehicle(model, edges, roads.lanes[lane].index, depart_pos_m=front))
    return number_vehicles(made, prefix)
