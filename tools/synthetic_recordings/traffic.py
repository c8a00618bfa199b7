"""Moving vehicles of a synthetic recording: CAVs, many of which turn, and SUMO's traffic around them."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.roads import Lane, RoadMap, build_lane_route, find_lane_path
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose

TURN_DEG = 45.0
"""[deg] A smaller change of direction over a junction is straight on."""
TURNING_SHARE = 0.75
"""Share of CAVs that turn."""
START_M = (10.0, 35.0)
"""[m] Distance of CAV starts from the end of their first lane; they start with `START_MPS`."""
START_MPS = 5.0
APART_M = 14.0
"""[m] From a CAV to any other vehicle at the start."""
GAP_M = 13.0
"""[m] Between vehicles on a lane at the start."""
TRUCK_SHARE = 0.08
"""Share of trucks among background vehicles."""
HEADWAY_S = (7.0, 16.0)
"""[s] Between vehicles that enter the map on one lane."""


@dataclass(frozen=True)
class VehicleStart:
    """Start position of a vehicle."""

    lane: Lane
    s: float
    """[m] of its centre (CAVs) or front bumper."""


def build_cavs(roads: RoadMap, count: int, rng: np.random.Generator) -> tuple[Ego, ...]:
    """Build CAVs well apart before junctions, on roads of one axis: lights then release them together."""
    found: list[Ego] = []
    while len(found) < count:
        ego = _build_cav(roads, str(len(found)), rng)
        if all(_is_apart(ego, other) and _share_axis(ego, other) for other in found):
            found.append(ego)
    return tuple(found)


def _is_apart(one: Ego, other: Ego) -> bool:
    return bool(np.hypot(one.start.x - other.start.x, one.start.y - other.start.y) > APART_M)


def _share_axis(one: Ego, other: Ego) -> bool:
    return abs(float(np.cos(one.start.yaw - other.start.yaw))) > np.cos(np.pi / 4)


def _build_cav(roads: RoadMap, name: str, rng: np.random.Generator) -> Ego:
    turns = bool(rng.random() < TURNING_SHARE)
    ways = [
        (first, last)
        for first, last in _list_junction_passes(roads)
        if (_compute_turn(first, last) > TURN_DEG) == turns
    ]
    first, last = ways[int(rng.integers(len(ways)))]
    lanes = find_lane_path(roads, first.id, last.id)
    begin = max(first.centre.length - float(rng.uniform(*START_M)), 5.0)
    route = build_lane_route(roads, lanes, begin, last.centre.length - 4.0)
    points = tuple(
        (round(float(x), 3), round(float(y), 3), round(float(yaw), 4))
        for (x, y), yaw in zip(route.xy, route.yaw, strict=True)
    )
    x, y, yaw = points[0]
    return Ego(id=name, start=Pose(x=x, y=y, yaw=yaw), start_speed=START_MPS, lanes=lanes, route=points)


def _list_junction_passes(roads: RoadMap) -> list[tuple[Lane, Lane]]:
    """Return pairs of lanes: one that leads into a junction, and one that follows it."""
    into = [lane for lane in roads.driving if not lane.junction and lane.successors]
    return [(lane, after) for lane in into for after in _find_lanes_beyond(roads, lane)]


def _find_lanes_beyond(roads: RoadMap, lane: Lane) -> list[Lane]:
    """Return the lanes behind the junction at a lane's end."""
    found: list[Lane] = []
    for name in lane.successors:
        after = roads.lanes[name]
        found += _find_lanes_beyond(roads, after) if after.junction else [after]
    return found


def _compute_turn(first: Lane, last: Lane) -> float:
    turn = last.centre.yaw_at(0.0) - first.centre.yaw_at(first.centre.length)
    return abs(math.degrees(math.remainder(turn, 2 * math.pi)))


def build_traffic(
    roads: RoadMap, egos: Sequence[Ego], count: int, until_s: float, rng: np.random.Generator
) -> tuple[BackgroundVehicle, ...]:
    """Build `count` vehicles present at the start, and others that enter the map until `until_s` [s]."""
    cars = np.array([(ego.start.x, ego.start.y) for ego in egos])
    free = [
        VehicleStart(lane, float(s))
        for lane in roads.driving
        if not lane.junction
        for s in np.arange(8.0, lane.centre.length - 4.0, GAP_M)
        if np.hypot(*(cars - lane.centre.at(float(s) - 2.5)).T).min() > APART_M
    ]
    chosen = sorted(rng.choice(len(free), min(count, len(free)), replace=False).tolist())
    early = [_build_vehicle(roads, f"bg{n}", free[k], 0.0, rng) for n, k in enumerate(chosen)]
    return (*early, *_build_later_traffic(roads, until_s, rng))


def _build_later_traffic(roads: RoadMap, until_s: float, rng: np.random.Generator) -> Iterator[BackgroundVehicle]:
    led_to = {name for lane in roads.driving for name in lane.successors}
    entries = [lane for lane in roads.driving if lane.id not in led_to and not lane.junction]
    for lane in entries:
        now = float(rng.uniform(*HEADWAY_S))
        while now < until_s:
            yield _build_vehicle(
                roads, f"late-{lane.id}-{round(10 * now)}", VehicleStart(lane, 6.0), round(now, 2), rng
            )
            now += float(rng.uniform(*HEADWAY_S))


def _build_vehicle(
    roads: RoadMap, name: str, start: VehicleStart, depart_s: float, rng: np.random.Generator
) -> BackgroundVehicle:
    """Build a vehicle that follows its lane and turns at random."""
    edges, lane = [start.lane.edge], start.lane
    while nexts := _find_lanes_beyond(roads, lane):
        lane = nexts[int(rng.integers(len(nexts)))]
        edges.append(lane.edge)
    lorry = rng.random() < TRUCK_SHARE
    length, width = (7.5, 2.4) if lorry else (float(rng.uniform(4.1, 5.0)), float(rng.uniform(1.7, 1.95)))
    return BackgroundVehicle(
        id=name,
        depart_s=depart_s,
        edges=tuple(edges),
        depart_lane=start.lane.index,
        depart_pos_m=round(start.s, 2),
        depart_speed=round(float(rng.uniform(4.0, 7.0)), 2),
        length=round(length, 2),
        width=round(width, 2),
    )
