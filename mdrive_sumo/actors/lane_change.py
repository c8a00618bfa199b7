"""To which side and how far an actor changes lanes (protocol 3.4)."""

import math

import numpy as np

from mdrive_sumo.actors.motion_path import Course
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.core.state import Frame
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor, LaneChange, LaneMotion

ON_LANE_M = 2.0
"""An actor on a path is on a lane whose centre line is no further away, and that it goes along."""
BESIDE_M = 0.5
"""A CAV further than this to the right of an actor's course is to its right."""
LANE_WIDTH_M = 3.5
"""Where no lane is near."""


def lane_change_m(actor: Actor, course: Course, at: tuple[float, float, float], frame: Frame, roads: RoadMap) -> float:
    """How far to the left [m] the next lane is from (x, y, yaw); negative to the right; 0 if there is none.

    An actor that goes along lanes changes only to a lane of the map; one with a path else goes over by a lane's width.
    """
    action = actor.action
    assert isinstance(action, LaneChange)
    left = (action.direction or _direction(action, course, frame)) == "left"
    lane = _lane_at(at, roads)
    neighbour = (lane.left if left else lane.right) if lane is not None else ""
    if lane is not None and neighbour:
        x, y = lane.centre.at(lane.centre.project(at[0], at[1])[0])
        return -roads.lanes[neighbour].centre.project(x, y)[1]
    if isinstance(actor.motion, LaneMotion):
        return 0.0
    width = lane.width if lane is not None else LANE_WIDTH_M
    return width if left else -width


def _direction(action: LaneChange, course: Course, frame: Frame) -> str:
    ego = frame.egos.get(action.target_vehicle or "")
    if ego is None:
        return "left"
    return "right" if course.line.project(ego.x, ego.y)[1] < -BESIDE_M else "left"


def _lane_at(at: tuple[float, float, float], roads: RoadMap) -> Lane | None:
    nearest = roads.nearest(np.array([at[:2]]))
    along = math.cos(wrap_angle(at[2] - float(nearest.yaw[0])))
    if nearest.distance[0] > ON_LANE_M or along < math.cos(math.pi / 4):
        return None
    return roads.driving[int(nearest.lane[0])]
