"""People on foot: alone and in groups along pavements, over streets, and standing before shops and schools."""

import random
from collections.abc import Iterator, Sequence

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor, GapTrigger, PathMotion, StartMotion
from mdrive_sumo.worlds.placement.bodies import BODIES, Body, build_actor
from mdrive_sumo.worlds.placement.lane_chains import build_pose
from mdrive_sumo.worlds.traffic.occupancy import TakenGround
from mdrive_sumo.worlds.traffic.traffic_demand import TrafficDemand
from mdrive_sumo.worlds.traffic.walking_ways import (
    Crossing,
    Spot,
    draw_side,
    draw_walk,
    find_crossing_at,
    find_nearest_footway,
    find_zebra_crossings,
)

WALK_MPS = (1.34, 0.26)
"""[m/s] Mean and standard deviation of walking speeds (Weidmann 1993)."""
SLOWER_PER_PERSON = 0.04
"""[m/s] A group walks slower by this for each person (Moussaid et al. 2010, population A)."""
WALK_BOUNDS = (0.6, 2.2)
"""[m/s] Drawn walking speeds are cut here, about three standard deviations from the mean."""
GROUP_SIZES = ((2, 0.7), (3, 0.2), (4, 0.1))
"""Sizes of groups and their weights: pairs are most of them (Moussaid et al. 2010); the weights are chosen."""
ABREAST_M = 0.75
"""[m] Distance between people who walk side by side (Moussaid et al. 2010: 0.78 in pairs)."""
WALK_S = 90.0
"""[s] A walk is drawn for this time, longer than most episodes."""
CROSS_S = (0.0, 35.0)
"""[s] When people look for a gap: chosen, within an episode."""
ADULT = BODIES["adult"]
CHILD = Body("child", "pedestrian", 0.4, 0.4)
"""A child of primary-school age; chosen."""
FRONT_PEOPLE = (4, 9)
"""People who stand before a shop or a school: chosen."""
FRONT_M = 7.0
"""[m] Length of such a front along the pavement: a shop of two windows, the gate of a school."""
FRONT_CROSSERS = 2
"""People of a front who cross the street there: chosen."""


def draw_people(
    roads: RoadMap, demand: TrafficDemand, taken: TakenGround, blocked: frozenset[str], rng: random.Random
) -> Iterator[Actor]:
    """Return all people on foot; `blocked`: edges whose pavement is taken by parked vehicles."""
    free = [k for k, way in enumerate(roads.footways) if way.edge not in blocked]
    yield from _draw_fronts(roads, free, demand, taken, rng)
    yield from _draw_zebra_crossers(roads, demand, taken, rng)
    yield from _draw_street_crossers(roads, free, demand, taken, rng)
    yield from _draw_walkers(roads, free, demand, taken, rng)


def _draw_speed(people: int, rng: random.Random) -> float:
    speed = rng.gauss(*WALK_MPS) - SLOWER_PER_PERSON * (people - 1)
    return round(min(max(speed, WALK_BOUNDS[0]), WALK_BOUNDS[1]), 2)


def _draw_group(demand: TrafficDemand, rng: random.Random) -> int:
    """Return how many people walk together."""
    if rng.random() >= demand.group_share:
        return 1
    return rng.choices([size for size, _ in GROUP_SIZES], [weight for _, weight in GROUP_SIZES])[0]


def _draw_walkers(
    roads: RoadMap, free: Sequence[int], demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[Actor]:
    for k in free:
        way = roads.footways[k]
        groups = rng.expovariate(1.0) * demand.walkers_per_km * way.centre.length / 1000.0
        for _ in range(int(groups + rng.random())):
            people, forward = _draw_group(demand, rng), rng.random() < 0.5
            station, side, speed = rng.uniform(0.0, way.centre.length), draw_side(way, rng), _draw_speed(people, rng)
            for number in range(people):
                row, column = divmod(number, 2 if way.width >= 2.0 else 1)
                back = station - row * 1.1 * (1 if forward else -1)
                offset = side + (column * ABREAST_M if side < 0 else -column * ABREAST_M)
                back = min(max(back, 0.0), way.centre.length)
                points = draw_walk(roads, (k, back, forward), speed * WALK_S, offset)
                yield from _build_walker(ADULT, points, speed, taken)


def _build_walker(body: Body, points: Sequence[Spot], speed: float, taken: TakenGround) -> Iterator[Actor]:
    """Return a pedestrian that walks from the start on, if the place is free."""
    (x, y), (x1, y1) = points[0], points[1]
    yaw = portable.atan2(y1 - y, x1 - x)
    if _take(body, (x, y), yaw, taken):
        motion = PathMotion(points=tuple(points), speed=speed, start_speed=speed)
        yield build_actor("walker", body, build_pose(x, y, yaw), motion=motion)


def _take(body: Body, spot: Spot, yaw: float, taken: TakenGround) -> bool:
    box = box_corners(*spot, yaw, body.length, body.width)
    if not taken.is_free(box):
        return False
    taken.take(box)
    return True


def _draw_zebra_crossers(
    roads: RoadMap, demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[Actor]:
    for crossing in find_zebra_crossings(roads):
        groups = rng.expovariate(1.0) * demand.crossers_per_zebra
        for _ in range(int(groups + rng.random())):
            yield from _draw_crossing_group(roads, crossing, _draw_group(demand, rng), taken, rng)


def _draw_street_crossers(
    roads: RoadMap, free: Sequence[int], demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[Actor]:
    """Return people who cross between junctions, without a zebra crossing."""
    for k in free:
        length = roads.footways[k].centre.length
        wanted, station = rng.random(), round(rng.uniform(0.0, length), 1)
        if wanted < demand.street_crossers_per_km * length / 1000.0:
            crossing = find_crossing_at(roads, k, station)
            if crossing is not None:
                yield from _draw_crossing_group(roads, crossing, _draw_group(demand, rng), taken, rng)


def _draw_crossing_group(
    roads: RoadMap,
    crossing: Crossing,
    people: int,
    taken: TakenGround,
    rng: random.Random,
    body: Body = ADULT,
) -> Iterator[Actor]:
    """Return people who wait for a gap together, cross side by side and walk on along the pavement."""
    ends = (crossing.start, crossing.end) if rng.random() < 0.5 else (crossing.end, crossing.start)
    free = max(crossing.width / 2 - 0.5, 0.0)
    middle, after_s, speed = rng.uniform(-free, free), round(rng.uniform(*CROSS_S), 2), _draw_speed(people, rng)
    for number in range(people):
        offset = middle + number * ABREAST_M * (-1.0 if middle > 0 else 1.0)
        yield from _build_crosser(roads, body, ends, offset, (after_s, speed), taken, rng)


def _build_crosser(
    roads: RoadMap,
    body: Body,
    ends: tuple[Spot, Spot],
    offset: float,
    pace: tuple[float, float],
    taken: TakenGround,
    rng: random.Random,
) -> Iterator[Actor]:
    """Return a pedestrian that waits and crosses, if the place is free; `pace`: from when on [s], speed [m/s]."""
    ((x0, y0), (x1, y1)), (after_s, speed) = ends, pace
    yaw = portable.atan2(y1 - y0, x1 - x0)
    shift_x, shift_y = -offset * portable.sin(yaw), offset * portable.cos(yaw)
    start, end = (x0 + shift_x, y0 + shift_y), (x1 + shift_x, y1 + shift_y)
    if not _take(body, start, yaw, taken):
        return
    onward: tuple[Spot, ...] = ()
    if (at := find_nearest_footway(roads, end)) is not None:
        onward = draw_walk(roads, (*at, rng.random() < 0.5), speed * WALK_S, draw_side(roads.footways[at[0]], rng))
    points = [(round(x, 3), round(y, 3)) for x, y in (start, end)]
    points += [spot for spot in onward if portable.distance(spot, end) > 0.3]
    yield build_actor(
        "crosser",
        body,
        build_pose(*start, yaw),
        motion=PathMotion(points=tuple(points), speed=speed),
        trigger=GapTrigger(after_s=after_s),
        action=StartMotion(),
    )


def _draw_fronts(
    roads: RoadMap, free: Sequence[int], demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[Actor]:
    """Return people who stand before schools and shops, and some of them who cross the street there."""
    places = [k for k in free if roads.footways[k].centre.length > 2 * FRONT_M + 40.0]
    for _ in range(int(demand.fronts + rng.random()) if places else 0):
        k, body = rng.choice(places), rng.choice((ADULT, CHILD))
        way = roads.footways[k]
        station = round(rng.uniform(20.0, way.centre.length - 20.0), 1)
        for _ in range(rng.randint(*FRONT_PEOPLE)):
            along, side = station + rng.uniform(-FRONT_M / 2, FRONT_M / 2), draw_side(way, rng)
            (x, y), turn = way.centre.at(along), way.centre.yaw_at(along)
            spot = (x - side * portable.sin(turn), y + side * portable.cos(turn))
            yaw = rng.uniform(-3.14, 3.14)
            if _take(body, spot, yaw, taken):
                yield build_actor("stander", body, build_pose(*spot, yaw))
        crossing = find_crossing_at(roads, k, station)
        if crossing is not None:
            yield from _draw_crossing_group(roads, crossing, FRONT_CROSSERS, taken, rng, body)
