"""Boxes of road users in frame 0: where CAVs, scripted actors and SUMO's vehicles are before anything moves."""

from collections.abc import Sequence

import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundMode, BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, LaneMotion, PathMotion, ReplayMotion
from mdrive_sumo.vehicle import dynamics

CAR = dynamics.MKZ_2017
MIN_PATH_M = 0.1
"""A path with all points within this distance [m] of its first is invalid."""


def build_box(pose: Pose, length: float, width: float) -> shapely.Polygon:
    """Return a box [m] as a polygon."""
    return shapely.Polygon(box_corners(pose.x, pose.y, pose.yaw, length, width))


def build_user_box(user: Ego | Actor, longer_m: float = 0.0) -> shapely.Polygon:
    """Return the box of a CAV or scripted actor at its `start`, `longer_m` longer."""
    length, width = (user.length, user.width) if isinstance(user, Actor) else (CAR.length, CAR.width)
    return build_box(user.start, length + longer_m, width)


def compute_first_pose(actor: Actor, roads: RoadMap) -> Pose:
    """Return the pose at which a motion begins, heading along it; it may lie beside the actor's `start`."""
    start = actor.start
    match actor.motion:
        case PathMotion(points=way):
            x, y = way[0]
            ahead = next((point for point in way if portable.distance(point, way[0]) > MIN_PATH_M), None)
            return Pose(x=x, y=y, yaw=portable.atan2(ahead[1] - y, ahead[0] - x) if ahead else start.yaw)
        case LaneMotion(lanes=lanes):
            centre = roads.lanes[lanes[0]].centre
            yaw = centre.yaw_at(min(max(centre.project(start.x, start.y)[0], 0.0), centre.length))
            return Pose(x=start.x, y=start.y, yaw=yaw)
        case ReplayMotion(poses=poses):
            _, x, y, yaw = poses[0]
            return Pose(x=x, y=y, yaw=yaw)
        case _:
            return start


def find_departure_pose(vehicle: BackgroundVehicle, roads: RoadMap, mode: BackgroundMode = "replay") -> Pose | None:
    """Return the box centre of a vehicle at its departure; None if its lane is not on the network.

    A vehicle with a log is on it, unless its traffic is reactive.
    """
    if vehicle.log and mode != "reactive":
        _, x, y, yaw = vehicle.log[0]
        return Pose(x=x, y=y, yaw=yaw)
    lane = roads.lanes.get(f"{vehicle.edges[0]}_{vehicle.depart_lane}")
    ahead = vehicle.depart_pos_m + (vehicle.schedule.progress[0][1] if vehicle.schedule else 0.0)
    while lane is not None and ahead > lane.centre.length:
        following = [roads.lanes[name] for name in lane.successors if _leads_to(roads, name, vehicle.edges)]
        if not following:
            break
        lane, ahead = following[0], ahead - lane.centre.length
    if lane is None:
        return None
    (x, y), yaw = lane.centre.at(ahead - vehicle.length / 2), lane.centre.yaw_at(ahead)
    offset = vehicle.parked.offset_m if vehicle.parked else 0.0
    return Pose(x=x - portable.sin(yaw) * offset, y=y + portable.cos(yaw) * offset, yaw=yaw)


def _leads_to(roads: RoadMap, name: str, edges: Sequence[str]) -> bool:
    """Return whether a lane lies on one of the edges, or leads there through a junction."""
    passed: set[str] = set()
    while roads.lanes[name].junction and name not in passed:
        passed.add(name)
        name = next(iter(roads.lanes[name].successors), name)
    return roads.lanes[name].edge in edges
