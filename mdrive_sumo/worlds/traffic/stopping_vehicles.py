"""Background vehicles that stop in their lane: buses at bus stops, vans that deliver in the second row."""

import random
from collections.abc import Iterator

from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.worlds.traffic.driving_vehicles import FIRST_FRONT_M, compute_start_speed, is_street
from mdrive_sumo.worlds.traffic.lane_walk import draw_way
from mdrive_sumo.worlds.traffic.occupancy import TakenGround, build_lane_box
from mdrive_sumo.worlds.traffic.traffic_demand import TrafficDemand
from mdrive_sumo.worlds.traffic.vehicle_classes import LARGE, VEHICLE_CLASSES, build_vehicle

DWELL_S = (8.0, 30.0)
"""[s] Time for which a bus stands at a stop (TCRP Report 165: 10 to 60 s are usual, 30 s typical of a busy stop)."""
BUS_AHEAD_M = 60.0
"""[m] A bus stands at its stop at the start, or is at most this far before it: chosen, so that an episode sees it."""
DELIVERY_S = (6.0, 20.0)
"""[s] For how long a van still delivers. Deliveries last minutes; an episode sees the end of one, and traffic waits
behind it: chosen."""
DELIVERY_END_M = 25.0
"""[m] No van delivers this close to either end of a lane: chosen, sight to a junction."""
BLOCK_BEHIND_M = 30.0
"""[m] Nothing that drives starts this close behind a vehicle that stands."""


def draw_buses(
    roads: RoadMap, demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[BackgroundVehicle]:
    """Return buses at the stops of the network, or on their way to them."""
    for stop in sorted(roads.bus_stops, key=lambda one: one.id):
        lane = roads.lanes.get(stop.lane)
        wanted, ahead_m, dwell_s = rng.random(), rng.uniform(0.0, BUS_AHEAD_M), rng.uniform(*DWELL_S)
        if lane is None or wanted >= demand.bus_stop_share:
            continue
        stop_m = min(max(lane.centre.project(*point)[0] for point in stop.line), lane.centre.length - 1.0)
        kind = VEHICLE_CLASSES["bus"]
        front = stop_m if ahead_m < BUS_AHEAD_M / 2 else max(stop_m - ahead_m, kind.length + FIRST_FRONT_M)
        speed = compute_start_speed(lane, stop_m - front, kind.driving.max_speed) if front < stop_m - 5.0 else 0.0
        if speed == 0.0:
            front = stop_m
        yield from _place_stopping(roads, lane, "bus", (front, stop_m, speed, dwell_s), demand, taken, rng)


def draw_deliveries(
    roads: RoadMap, demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[BackgroundVehicle]:
    """Return vans that stand in the rightmost lane of streets beside the parked rows."""
    for lane in sorted(roads.driving, key=lambda one: one.id):
        length = lane.centre.length
        if not is_street(lane) or lane.right or length < 2 * DELIVERY_END_M + 12.0:
            continue
        wanted, share = rng.random(), rng.random()
        stands_s = rng.uniform(*DELIVERY_S)
        if wanted < demand.deliveries_per_km * length / 1000.0:
            front = DELIVERY_END_M + 6.0 + share * (length - 2 * DELIVERY_END_M - 6.0)
            yield from _place_stopping(roads, lane, "van", (front, front, 0.0, stands_s), demand, taken, rng)


def _place_stopping(
    roads: RoadMap,
    lane: Lane,
    name: str,
    halt: tuple[float, float, float, float],
    demand: TrafficDemand,
    taken: TakenGround,
    rng: random.Random,
) -> Iterator[BackgroundVehicle]:
    """Return the vehicle if its place is free; `halt`: front, stop [m], speed [m/s] and how long it stands [s]."""
    front, stop_m, speed, stands_s = halt
    kind = VEHICLE_CLASSES[name]
    box = build_lane_box(roads, lane.id, front, (kind.length, kind.width))
    if front < kind.length + FIRST_FRONT_M or taken.is_kept_free(lane.id, front - kind.length, front):
        return
    way = draw_way(roads, lane.id, demand.turn_shares, rng)
    if not taken.is_free(box) or (name in LARGE and not way.fits_large):
        return
    taken.take(box)
    taken.keep_free([(lane.id, max(front - kind.length - BLOCK_BEHIND_M, 0.0), front)])
    stop = {"edge": lane.edge, "lane": lane.index, "pos_m": round(stop_m, 2), "duration_s": round(stands_s, 2)}
    fields = {"depart_lane": lane.index, "depart_pos_m": round(front, 2), "depart_speed": speed}
    yield build_vehicle(name, way.edges, stops=[stop], keeps_lane=way.keeps_lane, **fields)
