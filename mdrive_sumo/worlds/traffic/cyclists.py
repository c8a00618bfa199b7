"""Cyclists and e-scooters that SUMO drives: on cycle lanes where there are some, else at the side of streets."""

import random
from collections.abc import Iterator

from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle, CarFollowing
from mdrive_sumo.worlds.placement.bodies import BODIES
from mdrive_sumo.worlds.traffic.driving_vehicles import compute_start_speed, is_street
from mdrive_sumo.worlds.traffic.lane_walk import Way, draw_way
from mdrive_sumo.worlds.traffic.occupancy import TakenGround, build_box_on
from mdrive_sumo.worlds.traffic.traffic_demand import TrafficDemand
from mdrive_sumo.worlds.traffic.vehicle_classes import build_vehicle

CYCLE_MPS = (3.6, 6.2)
"""[m/s] Speeds that cyclists wish: means of 4.3 on conventional bicycles, 4.8 on pedelecs (Schleinitz et al. 2017)."""
SCOOTER_MPS = (3.9, 5.5)
"""[m/s] E-scooters: at most 20 km/h (German regulation eKFV), 14 km/h in dense traffic: chosen."""
SCOOTER_SHARE = 0.15
"""Share of e-scooters among them: chosen."""
FREE_M = 15.0
AROUND_M = (-FREE_M, -FREE_M / 2, 0.0, FREE_M / 2, FREE_M)
"""[m] Free length before and behind a cyclist at the start: a vehicle at 36 km/h behind one who stands needs 15 m."""


def draw_cyclists(
    roads: RoadMap, demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[BackgroundVehicle]:
    """Return the cyclists of all cycle lanes, and of streets without one."""
    with_lane = {lane.edge for lane in roads.cycle_lanes.values()}
    lanes = [lane for lane in roads.cycle_lanes.values() if not lane.junction]
    lanes += [lane for lane in roads.driving if is_street(lane) and not lane.right and lane.edge not in with_lane]
    for lane in sorted(lanes, key=lambda one: one.id):
        count = rng.expovariate(1.0) * demand.cyclists_per_km * lane.centre.length / 1000.0
        for _ in range(int(count + rng.random())):
            yield from _place(roads, lane, demand, taken, rng)


def _place(
    roads: RoadMap, lane: Lane, demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[BackgroundVehicle]:
    model = "e-scooter" if rng.random() < SCOOTER_SHARE else "bicycle"
    top = rng.uniform(*(SCOOTER_MPS if model == "e-scooter" else CYCLE_MPS))
    length, width = BODIES[model].length, BODIES[model].width
    front = rng.uniform(length + 1.0, max(lane.centre.length - 2.0, length + 1.0))
    around = [build_box_on(lane.centre, front + step, (length + FREE_M / 2, width)) for step in AROUND_M]
    if front > lane.centre.length or taken.is_kept_free(lane.id, front - length, front):
        return
    if not all(map(taken.is_free, around)):
        return
    way = _draw_way(roads, lane, demand, rng)
    taken.take(build_box_on(lane.centre, front, (length, width)))
    following = CarFollowing(accel=1.2, decel=3.0, min_gap_m=1.0, sigma=0.2, max_speed=round(top, 2))
    yield build_vehicle(
        model,
        way.edges,
        kind="cyclist",
        keeps_lane=way.keeps_lane,
        length=length,
        width=width,
        driving=following,
        depart_lane=lane.index,
        depart_pos_m=round(front, 2),
        depart_speed=compute_start_speed(lane, lane.centre.length - front, top),
    )


def _draw_way(roads: RoadMap, lane: Lane, demand: TrafficDemand, rng: random.Random) -> Way:
    """Return the way of a cyclist: along cycle lanes as far as they lead, on a street as vehicles drive."""
    if lane.id not in roads.cycle_lanes:
        return draw_way(roads, lane.id, demand.turn_shares, rng)
    edges, passed = [lane.edge], {lane.id}
    while onward := [id_ for id_ in lane.successors if id_ in roads.cycle_lanes and id_ not in passed]:
        lane = roads.cycle_lanes[rng.choice(onward)]
        passed.add(lane.id)
        if not lane.junction:
            edges.append(lane.edge)
    return Way(tuple(edges), keeps_lane=True, fits_large=False)
