"""Parked vehicles: rows where the network has them, else at the kerb; and the vehicles among them that pull out."""

import random
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Polyline, box_corners, build_polyline, wrap_angle
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.worlds.placement.lane_chains import build_pose
from mdrive_sumo.worlds.traffic.driving_vehicles import FIRST_FRONT_M, is_street
from mdrive_sumo.worlds.traffic.lane_walk import draw_way, walk_upstream
from mdrive_sumo.worlds.traffic.occupancy import TakenGround
from mdrive_sumo.worlds.traffic.traffic_demand import TrafficDemand
from mdrive_sumo.worlds.traffic.vehicle_classes import VEHICLE_CLASSES, build_vehicle

GAP_M = (0.7, 1.5)
"""[m] Gaps of a parked row: places of 5.2 to 6.0 m for cars (EAR 05), of which vehicles take most."""
VAN_SHARE = 0.18
"""Share of vans among parked vehicles: chosen; the others are cars."""
KERB_FREE_M = 12.0
"""[m] Nothing parks at the kerb this close to the ends of a lane: StVO § 12 asks for 5 m before junctions and
crossings, and a crossing lies between the end of the lane and the junction."""
KERB_SIDE_M = 0.15
"""[m] From the edge of the lane to the side of a vehicle that parks at the kerb."""
BESIDE_M, ALIGNED_RAD = 5.0, 0.25
"""A place belongs to a lane whose centre line is at most this far away [m] and runs along it within this angle."""
STRAIGHT_RAD = 0.03
"""[rad] In a bend a row is longer or shorter than its lane: nothing pulls out there."""
OUT_M = 12.0
"""[m] Along the row, a vehicle needs this to pull out; SUMO's side shows it doing so within 14 m."""
LEAVES_S = (1.0, 14.0)
"""[s] When a vehicle begins to look for a gap: chosen, within an episode."""


@dataclass(frozen=True, slots=True)
class ParkedPlace:
    """A parked vehicle: its middle is at a station [m] of a lane, at an offset [m] from its centre line."""

    model: str
    pose: Pose
    lane: str
    """"" if no lane runs along it: in a car park."""
    station: float
    offset: float
    is_foremost: bool
    """Whether the next place ahead is free."""

    @property
    def size(self) -> tuple[float, float]:
        """Length and width [m]."""
        kind = VEHICLE_CLASSES[self.model]
        return kind.length, kind.width


def draw_parked(roads: RoadMap, demand: TrafficDemand, taken: TakenGround, rng: random.Random) -> list[ParkedPlace]:
    """Return the parked vehicles, whose ground is taken then."""
    if roads.parking:
        return [place for row in sorted(roads.parking, key=lambda one: one.id)
                for place in _fill_row(roads, build_polyline(row.line), demand, taken, rng)]  # fmt: skip
    with_cycles = {lane.edge for lane in roads.cycle_lanes.values()}
    kerbs = [lane for lane in sorted(roads.driving, key=lambda one: one.id) if lane.edge not in with_cycles]
    return [place for lane in kerbs for place in _fill_kerb(roads, lane, demand, taken, rng)]


def _fill_kerb(
    roads: RoadMap, lane: Lane, demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[ParkedPlace]:
    """Return vehicles at the kerb of a street whose network has no parking rows, on some streets."""
    is_used = rng.random() < demand.kerb_share
    if not is_used or not is_street(lane) or lane.right or lane.centre.length < 2 * KERB_FREE_M + 12.0:
        return
    offset = -(lane.width / 2 + KERB_SIDE_M + VEHICLE_CLASSES["van"].width / 2)
    stations = np.arange(KERB_FREE_M, lane.centre.length - KERB_FREE_M, 4.0).tolist()
    points = [_move(lane.centre, station, offset) for station in stations]
    yield from _fill_row(roads, build_polyline(points), demand, taken, rng)


def _move(line: Polyline, station: float, offset: float) -> tuple[float, float]:
    (x, y), yaw = line.at(station), line.yaw_at(station)
    return x - offset * portable.sin(yaw), y + offset * portable.cos(yaw)


def _fill_row(
    roads: RoadMap, line: Polyline, demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[ParkedPlace]:
    """Return the vehicles along a line, from its end back."""
    front, is_free_ahead = line.length - rng.uniform(*GAP_M) / 2, True
    if line.length < 8.0:  # a stall of a car park
        front = line.length / 2 + VEHICLE_CLASSES["car"].length / 2
    while True:
        model = "van" if rng.random() < VAN_SHARE and line.length > 8.0 else "car"
        is_taken, gap = rng.random() < demand.parked_share, rng.uniform(*GAP_M)
        kind = VEHICLE_CLASSES[model]
        middle = front - kind.length / 2
        if middle - kind.length / 2 < -0.4:
            return
        (x, y), yaw = line.at(middle), line.yaw_at(middle)
        box = box_corners(x, y, yaw, kind.length, kind.width)
        is_parked = is_taken and taken.is_free(box) and not _is_in_building(roads, x, y)
        if is_parked:
            taken.take(box)
            pose = build_pose(x, y, yaw)
            yield ParkedPlace(model, pose, *_find_lane(roads, pose), is_free_ahead)
        front -= kind.length + gap
        is_free_ahead = not is_parked


def _is_in_building(roads: RoadMap, x: float, y: float) -> bool:
    """Return whether a point lies within the bounds of a building."""
    bounds = _list_bounds(roads)
    return bool(((bounds[:, 0] < x) & (x < bounds[:, 2]) & (bounds[:, 1] < y) & (y < bounds[:, 3])).any())


@lru_cache(maxsize=32)
def _list_bounds(roads: RoadMap) -> Float:
    """Return least x and y, greatest x and y [m] (B, 4) of the buildings."""
    outlines = [building.outline for building in roads.buildings]
    return np.array([(*one.min(axis=0), *one.max(axis=0)) for one in outlines]).reshape(-1, 4)


def _find_lane(roads: RoadMap, pose: Pose) -> tuple[str, float, float]:
    """Return lane id, station and offset [m] of a pose; "" where no lane runs along it."""
    nearest = roads.find_nearest_lanes(np.array([[pose.x, pose.y]]))
    lane = roads.driving[int(nearest.lane[0])]
    turned = abs(wrap_angle(pose.yaw - float(nearest.yaw[0])))
    if lane.junction or nearest.distance[0] > BESIDE_M or turned > ALIGNED_RAD:
        return "", 0.0, 0.0
    station, offset = lane.centre.project(pose.x, pose.y)
    return lane.id, station, offset


def draw_pull_outs(
    roads: RoadMap, places: Sequence[ParkedPlace], demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> dict[int, BackgroundVehicle]:
    """Return vehicles that pull out, by their index among the places: SUMO drives them, they are no longer parked.

    Only from the foremost place of a row, onto the only lane of its direction without a cycle lane between.
    """
    with_cycles = {lane.edge for lane in roads.cycle_lanes.values()}
    chosen: dict[int, BackgroundVehicle] = {}
    for k, place in enumerate(places):
        wanted, leaves_s = rng.random(), rng.uniform(*LEAVES_S)
        if not place.lane or not place.is_foremost or wanted >= demand.pull_out_share:
            continue
        lane = roads.lanes[place.lane]
        front = place.station + place.size[0] / 2
        if lane.left or lane.right or lane.edge in with_cycles or not 0 < front < lane.centre.length - 20.0:
            continue
        if front < place.size[0] + FIRST_FRONT_M or taken.is_kept_free(lane.id, front - place.size[0], front):
            continue
        turned = wrap_angle(lane.centre.yaw_at(front) - lane.centre.yaw_at(front - place.size[0]))
        x, y = _move(lane.centre, front + 0.3 + OUT_M / 2, place.offset)
        way = box_corners(x, y, place.pose.yaw, OUT_M, place.size[1] + 0.6)
        if abs(turned) > STRAIGHT_RAD or not taken.is_free(way):
            continue
        taken.take(way)  # people do not wait in its way
        taken.keep_free(walk_upstream(roads, lane.id, front + 3.0, place.size[0] + 12.0))
        onward = draw_way(roads, lane.id, demand.turn_shares, rng)
        parked = {"offset_m": round(place.offset, 3), "leaves_s": round(leaves_s, 2)}
        fields = {"depart_lane": lane.index, "depart_pos_m": round(front, 2), "parked": parked}
        chosen[k] = build_vehicle(place.model, onward.edges, keeps_lane=onward.keeps_lane, **fields)
    return chosen
