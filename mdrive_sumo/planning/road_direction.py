"""The direction of the road along a route: traffic in lanes follows it, also where the own route changes lanes."""

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import Briefing, Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, wrap_angles
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.reference_path import SPACING_M, ReferencePath

PARALLEL_RAD = 0.03
"""A vehicle that turns away from the direction of the road by less keeps its lane: a lane change within 5 s at 20 m/s
turns by 0.05, and tracks err by about 0.01."""
MIN_SPEED = 5.0
"""[m/s] A slower vehicle may turn anywhere."""
MAX_LATERAL_M = 20.0
"""Traffic further aside has a road of its own."""
SHARP_TURN_RAD = 0.6
"""Where the route turns by more within a prediction, at a junction, other vehicles go straight on: most do."""
PREVIEW_S = 4.0
"""Bends of the road are averaged over this time ahead."""


class RoadPosition(NamedTuple):
    """Where objects are relative to the road of a route; all arrays are (N,)."""

    station: Float
    """[m] along the path."""
    lateral: Float
    """[m] left of the path."""
    turned: Float
    """[rad] Heading relative to the direction of the road."""


@dataclass(frozen=True)
class RoadDirection:
    """The line that starts with the route and always follows the direction of its assigned lanes."""

    s: Float
    """(N,) arc lengths [m]."""
    yaw: Float
    """(N,) [rad], unwrapped."""
    xy: Float
    """(N, 2) [m]"""

    def get_yaw(self, s: Float) -> Float:
        """Return the direction [rad] at arc lengths s (K,); beyond the ends the last one."""
        return np.interp(s, self.s, self.yaw)

    def get_points(self, s: Float) -> Float:
        """Return the points (K, 2) at arc lengths s (K,), straight on beyond the ends."""
        return find_points(self, s)

    def locate(self, path: ReferencePath, objects: Objects) -> RoadPosition:
        """Return the positions of objects relative to the path and to this direction."""
        return locate_objects(self, path, objects)


@twin
def find_points(road: RoadDirection, s: Float, /) -> Float:
    """As `RoadDirection.get_points`."""
    points = np.column_stack([np.interp(s, road.s, road.xy[:, axis]) for axis in (0, 1)])
    over = s - np.clip(s, road.s[0], road.s[-1])
    cos, sin = portable.cos_sin(road.get_yaw(s))
    return points + over[:, None] * np.column_stack((cos, sin))


@twin
def locate_objects(road: RoadDirection, path: ReferencePath, objects: Objects, /) -> RoadPosition:
    """As `RoadDirection.locate`."""
    dx, dy = objects.x[:, None] - path.xy[::4, 0], objects.y[:, None] - path.xy[::4, 1]
    i = (dx * dx + dy * dy).argmin(axis=1) * 4
    cos, sin = portable.cos_sin(path.yaw[i])
    dx, dy = objects.x - path.xy[i, 0], objects.y - path.xy[i, 1]
    station = i * SPACING_M + dx * cos + dy * sin
    return RoadPosition(station, dy * cos - dx * sin, wrap_angles(objects.yaw - road.get_yaw(station)))


def build_road_direction(briefing: Briefing) -> RoadDirection:
    """Return the direction of the road along the route of a briefing."""
    yaw = np.unwrap(briefing.route_yaw)
    cos, sin = portable.cos_sin((yaw[1:] + yaw[:-1]) / 2)
    steps = np.diff(briefing.route_s)[:, None] * np.column_stack((cos, sin))
    xy = briefing.route_xy[0] + np.concatenate((np.zeros((1, 2)), np.cumsum(steps, axis=0)))
    return RoadDirection(briefing.route_s, yaw, xy)


def find_lane_keeping(objects: Objects, position: RoadPosition, max_turn_rad: float = PARALLEL_RAD) -> Bool:
    """Return a mask (N,): vehicles that drive in the direction of the road or against it, near the route."""
    is_parallel = np.abs(portable.sin(position.turned)) < max_turn_rad
    is_moving = (objects.kind == Kind.VEHICLE) & (np.abs(objects.speed) > MIN_SPEED)
    return is_moving & is_parallel & (np.abs(position.lateral) < MAX_LATERAL_M)


def align_with_road(
    road: RoadDirection, path: ReferencePath, objects: Objects, curvature: Float
) -> tuple[Objects, Float]:
    """Return the objects and their curvatures (N,) [1/m], those of vehicles that keep their lane as the road has them.

    Over 100 m and more an error of a heading of 1 degree would lead every one of them into the next lane.
    """
    position = road.locate(path, objects)
    keeps = find_lane_keeping(objects, position)
    if not keeps.any():
        return objects, curvature
    forward = np.where(np.abs(position.turned) < np.pi / 2, 1.0, -1.0)
    here = road.get_yaw(position.station)
    ahead_m = PREVIEW_S * np.maximum(np.abs(objects.speed), MIN_SPEED)
    turn = road.get_yaw(position.station + forward * ahead_m) - here
    bend = np.where(np.abs(turn) < SHARP_TURN_RAD, turn, 0.0) / ahead_m
    yaw = np.where(forward > 0, here, here + np.pi)
    aligned = replace(objects, yaw=np.where(keeps, yaw, objects.yaw))
    return aligned, np.where(keeps, bend, curvature)
