"""People who get out of parked vehicles: the door opens into the street, they walk round to the pavement."""

import random
from collections.abc import Iterator, Sequence

from mdrive_sumo.core import portable
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion
from mdrive_sumo.worlds.placement.bodies import BODIES, Body, build_actor
from mdrive_sumo.worlds.placement.lane_chains import build_pose
from mdrive_sumo.worlds.traffic.lane_walk import walk_upstream
from mdrive_sumo.worlds.traffic.occupancy import TakenGround
from mdrive_sumo.worlds.traffic.parked_streets import ParkedPlace
from mdrive_sumo.worlds.traffic.traffic_demand import TrafficDemand

DOOR = Body("car-door", "static", 1.0, 0.12)
"""Front doors of cars are about 1 m long and 0.12 m thick."""
HINGE_M = 0.8
"""[m] The hinge lies this far before the middle of the vehicle."""
CLEAR_M = 0.1
"""[m] From the side of the vehicle to the middle of its closed door, which must not overlap it."""
OPEN_RAD, SWING_S, OUT_S = 1.1, 0.8, 2.5
"""[rad], [s] A door opens by 63 degrees within 0.8 s and closes 2.5 s after that: chosen."""
OPENS_S = (0.5, 4.0)
"""[s] When it opens. Until then, and as long as braking takes, nothing that drives starts near: people look
before they open a door."""
BRAKE_DECEL, BRAKE_S = 4.0, 1.5
"""[m/s2], [s] How background drivers stop for an open door: SUMO's brake at 4.5 and decide every half second."""
STEP_M = 0.45
"""[m] People walk this far beside the vehicle."""
WALK_MPS = 1.2
"""[m/s] Along the vehicle: a little slower than people walk (1.34)."""


def draw_door_openers(
    roads: RoadMap, places: Sequence[ParkedPlace], demand: TrafficDemand, taken: TakenGround, rng: random.Random
) -> Iterator[Actor]:
    """Return doors and the people who get out, at vehicles parked to the right of a lane."""
    with_cycles = {lane.edge for lane in roads.cycle_lanes.values()}
    for place in places:
        wanted, opens_s = rng.random(), round(rng.uniform(*OPENS_S), 2)
        if not place.lane or place.offset > -1.5 or wanted >= demand.door_share:
            continue
        lane = roads.lanes[place.lane]
        if lane.edge in with_cycles:
            continue
        speed = lane.speed_limit * 1.2  # SUMO's fastest drivers
        needed = speed * (opens_s + BRAKE_S) + speed * speed / (2 * BRAKE_DECEL) + place.size[0]
        taken.keep_free(walk_upstream(roads, lane.id, min(place.station + 3.0, lane.centre.length), needed))
        yield _build_door(place, opens_s)
        yield _build_driver(place, opens_s)


def _locate(place: ParkedPlace, ahead: float, left: float) -> tuple[float, float]:
    cos, sin = portable.cos_sin(place.pose.yaw)
    return place.pose.x + cos * ahead - sin * left, place.pose.y + sin * ahead + cos * left


def _build_door(place: ParkedPlace, opens_s: float) -> Actor:
    hinge = _locate(place, HINGE_M, place.size[1] / 2 + CLEAR_M)
    poses = [(_swing(place.pose, hinge, angle)) for angle in (0.0, OPEN_RAD / 2, OPEN_RAD)]
    closed, half, opened = poses
    at_s = (0.0, opens_s, opens_s + SWING_S / 2, opens_s + SWING_S)
    closes_s = at_s[-1] + OUT_S
    timed = [*zip(at_s, (closed, closed, half, opened), strict=True)]
    timed += [(closes_s, opened), (closes_s + SWING_S / 2, half), (closes_s + SWING_S, closed)]
    motion = ReplayMotion(poses=tuple((round(s, 2), one.x, one.y, one.yaw) for s, one in timed), stays=True)
    return build_actor("door", DOOR, closed, motion=motion)


def _swing(car: Pose, hinge: tuple[float, float], angle: float) -> Pose:
    """Return the pose of the door, which points from its hinge to the rear and swings to the left."""
    yaw = car.yaw - angle  # its length lies along the vehicle when it is closed
    cos, sin = portable.cos_sin(yaw)
    return build_pose(hinge[0] - cos * DOOR.length / 2, hinge[1] - sin * DOOR.length / 2, yaw)


def _build_driver(place: ParkedPlace, opens_s: float) -> Actor:
    """Return the driver on the way out: beside the vehicle, round its rear, onto the pavement."""
    side, rear = place.size[1] / 2 + STEP_M, -place.size[0] / 2 - 0.45
    spots = [_locate(place, *spot) for spot in ((-0.3, side), (rear, side), (rear, -side - 0.6))]
    begins_s, poses = opens_s + SWING_S + 0.6, list[tuple[float, float, float, float]]()
    for k, (x, y) in enumerate(spots):
        if k:
            begins_s += portable.distance(spots[k - 1], (x, y)) / WALK_MPS
        ahead, behind = spots[min(k + 1, 2)], spots[min(k, 1)]
        yaw = portable.atan2(ahead[1] - behind[1], ahead[0] - behind[0])
        poses.append((round(begins_s, 2), round(x, 3), round(y, 3), round(yaw, 4)))
    start = build_pose(poses[0][1], poses[0][2], poses[0][3])
    return build_actor("driver", BODIES["adult"], start, motion=ReplayMotion(poses=tuple(poses)))
