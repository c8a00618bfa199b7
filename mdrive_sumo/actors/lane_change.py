"""Direction and lateral distance of a scripted lane change (protocol 3.4)."""

import math

import numpy as np

from mdrive_sumo.actors.motion_path import MotionPath
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.core.state import Frame
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scripted_actor import Actor, LaneChange, LaneMotion

ON_LANE_M = 2.0
"""An actor is on a lane if the centre line is at most this far away [m] and the headings agree."""
BESIDE_M = 0.5
"""[m] A CAV further than this to the right of an actor's path is to its right."""
LANE_WIDTH_M = 3.5
"""[m] Used where no lane is near."""


def compute_lane_change_offset(
    actor: Actor, path: MotionPath, pose: tuple[float, float, float], frame: Frame, roads: RoadMap
) -> float:
    """Return the lateral distance [m] from `at` (x, y, yaw) to the adjacent lane; negative to the right, 0 if none.

    An actor that follows lanes changes only to a lane of the map; one that follows a path moves by one lane width.
    """
    action = actor.action
    assert isinstance(action, LaneChange)
    left = (action.direction or _choose_direction(action, path, frame)) == "left"
    lane = _find_lane(pose, roads)
    neighbour = (lane.left if left else lane.right) if lane is not None else ""
    if lane is not None and neighbour:
        x, y = lane.centre.at(lane.centre.project(pose[0], pose[1])[0])
        return -roads.lanes[neighbour].centre.project(x, y)[1]
    if isinstance(actor.motion, LaneMotion):
        return 0.0
    width = lane.width if lane is not None else LANE_WIDTH_M
    return width if left else -width


def _choose_direction(action: LaneChange, path: MotionPath, frame: Frame) -> str:
    ego = frame.egos.get(action.target_vehicle or "")
    if ego is None:
        return "left"
    return "right" if path.line.project(ego.x, ego.y)[1] < -BESIDE_M else "left"


def _find_lane(pose: tuple[float, float, float], roads: RoadMap) -> Lane | None:
    nearest = roads.find_nearest_lanes(np.array([pose[:2]]))
    alignment = portable.cos(wrap_angle(pose[2] - float(nearest.yaw[0])))
    if nearest.distance[0] > ON_LANE_M or alignment < portable.cos(math.pi / 4):
        return None
    return roads.driving[int(nearest.lane[0])]
