"""The path that a built-in agent drives, and how it becomes a plan.

A route is a chain of 1 m points; a path is the same way smoothed, prolonged beyond the goal and sampled densely, with
its curvature and the direction that the car's body takes on it.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from mdrive_sumo.contract import Briefing, Plan
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline, wrap_angle

SPACING_M = 0.25
"""Between the points of a path."""
RUN_OUT_M = 10.0
"""A path goes on beyond the goal, so that a car passes it at speed: a route is completed by passing its end."""
SMOOTHING_M = 2.0
"""Half width of the moving average that rounds kinks of lane geometry; it cuts a 6 m bend by 4 / (6 · 6) = 0.11 m."""
ASKEW = 0.15
"""[rad]"""
JOIN_M = 16.0
PLAN_INTERVAL_S = 0.2
PLAN_POINTS = 15

SpeedLimit: TypeAlias = Callable[[float], float]


@dataclass(frozen=True)
class Path:
    """A way to drive, all arrays (M,) with a point every `SPACING_M` metres: arc length of point i is i · SPACING_M."""

    xy: Float
    """(M, 2) box centres [m]."""
    yaw: Float
    """Direction of the path [rad], unwrapped."""
    body_yaw: Float
    """Direction of the car's body [rad]: its rear axle follows, so it turns later than the path of its centre."""
    curvature: Float
    """[1/m], left positive."""
    goal_s: float
    """Arc length of the route's end [m]."""

    @property
    def length(self) -> float:
        """Arc length of the last point [m]."""
        return (len(self.xy) - 1) * SPACING_M

    def points(self, s: Float) -> Float:
        """Points (K, 2) at arc lengths s (K,); beyond the end the last point."""
        index = s / SPACING_M
        grid = np.arange(len(self.xy))
        return np.column_stack((np.interp(index, grid, self.xy[:, 0]), np.interp(index, grid, self.xy[:, 1])))

    def project(self, x: float, y: float, near_s: float, within_m: float = 10.0) -> float:
        """Arc length of the point nearest to (x, y), searched within that distance along the path of near_s."""
        low = max(int((near_s - within_m) / SPACING_M), 0)
        high = min(int((near_s + within_m) / SPACING_M) + 2, len(self.xy))
        low = min(low, high - 1)
        gap = np.array((x, y)) - self.xy[low:high]
        i = low + int(np.argmin((gap**2).sum(1)))
        along = math.cos(self.yaw[i]) * (x - self.xy[i, 0]) + math.sin(self.yaw[i]) * (y - self.xy[i, 1])
        return min(max(i * SPACING_M + along, 0.0), self.length)


def path_station(path: Path, briefing: Briefing, route_s: float) -> float:
    """Arc length [m] on the (smoother, so shorter) path of an arc length on the route."""
    x, y = (float(np.interp(route_s, briefing.route_s, briefing.route_xy[:, axis])) for axis in (0, 1))
    return path.project(x, y, route_s)


def make_path(route_xy: Float, rear_to_centre: float, start_yaw: float | None = None) -> Path:
    """The path of a route (N, 2) for a car whose box centre lies `rear_to_centre` [m] before its rear axle.

    start_yaw: the car's direction [rad]; where the route leaves at an angle to it (a lane change from the first metre
    on) the path begins straight and joins the route within `JOIN_M`.
    """
    route = build_polyline(route_xy)
    if start_yaw is not None and abs(wrap_angle(float(route.yaws[0]) - start_yaw)) > ASKEW:
        route = _joined(route, start_yaw)
    ends = [route.at(-SMOOTHING_M), *route.xy, route.at(route.length + RUN_OUT_M + SMOOTHING_M)]
    fine = build_polyline(ends).resampled(SPACING_M).xy
    half = round(SMOOTHING_M / SPACING_M)
    window = np.full(2 * half + 1, 1 / (2 * half + 1))
    smooth = np.column_stack([np.convolve(fine[:, axis], window, mode="valid") for axis in (0, 1)])
    xy = build_polyline(smooth).resampled(SPACING_M).xy[:-1]
    return path_through(xy, rear_to_centre, start_yaw, goal_s=build_polyline(xy).project(*route.xy[-1].tolist())[0])


def path_through(xy: Float, rear_to_centre: float, start_yaw: float | None, goal_s: float) -> Path:
    """The path over smooth points xy (M, 2) [m] every `SPACING_M`, as it is."""
    yaw = np.unwrap(np.arctan2(np.gradient(xy[:, 1]), np.gradient(xy[:, 0])))
    return Path(xy, yaw, _body_yaw(yaw, rear_to_centre, start_yaw), _curvature(yaw), goal_s)


def _joined(route: Polyline, start_yaw: float) -> Polyline:
    """The route with its beginning bent towards the straight line that a car of that direction would drive."""
    s = np.minimum(route.s, JOIN_M)[:, None]
    straight = route.xy[0] + s * np.array((math.cos(start_yaw), math.sin(start_yaw)))
    share = s / JOIN_M
    weight = share**2 * (3 - 2 * share)
    return build_polyline(straight * (1 - weight) + route.xy * weight)


def _curvature(yaw: Float) -> Float:
    """Change of direction over the 2 m around each point, so that a kink counts as the bend that a car makes of it."""
    reach = round(1.0 / SPACING_M)
    padded = np.concatenate((np.full(reach, yaw[0]), yaw, np.full(reach, yaw[-1])))
    return (padded[2 * reach :] - padded[: -2 * reach]) / (2 * reach * SPACING_M)


def _body_yaw(yaw: Float, rear_to_centre: float, start_yaw: float | None) -> Float:
    """Kinematic single-track model: d body / ds = sin(yaw - body) / rear_to_centre."""
    first = float(yaw[0])
    body = [first if start_yaw is None else first + wrap_angle(start_yaw - first)]
    for direction in yaw[:-1].tolist():
        body.append(body[-1] + SPACING_M * math.sin(direction - body[-1]) / rear_to_centre)
    return np.array(body)


def curve_speeds(path: Path, cruise: float, lateral: float, braking: float) -> Float:
    """Highest speed (M,) [m/s] at every point: cruise, or what keeps within `lateral` and `braking` [m/s2]."""
    bend = np.minimum(cruise, np.sqrt(lateral / np.maximum(np.abs(path.curvature), 1e-6)))
    speeds = bend.tolist()
    for i in range(len(speeds) - 2, -1, -1):
        speeds[i] = min(speeds[i], math.sqrt(speeds[i + 1] ** 2 + 2 * braking * SPACING_M))
    return np.array(speeds)


class Reference:
    """Where on its path an agent wants to be: arc length s [m] and speed [m/s], kept from tick to tick.

    A plan that began at the measured state anew on every tick would ask a standing car for almost nothing; this one
    runs ahead of the car by what its actuators lag, and never by more than `LEAD_M` and `LEAD_SPEED`, so that a car
    that was stopped by force does not chase it.
    """

    LEAD_M = 1.0
    LEAD_SPEED = 1.5

    def __init__(self, path: Path) -> None:
        self.path = path
        self.s = 0.0
        self.speed = 0.0
        self.actual_s = 0.0

    def follow(self, x: float, y: float, speed: float) -> None:
        """Takes notice of the measured box centre [m] and speed [m/s]."""
        self.actual_s = self.path.project(x, y, self.actual_s)
        self.s = min(max(self.s, self.actual_s - self.LEAD_M), self.actual_s + self.LEAD_M)
        self.speed = min(max(self.speed, speed - self.LEAD_SPEED, 0.0), max(speed, 0.0) + self.LEAD_SPEED)

    def plan(self, acceleration: float, limits: Float, tick_s: float) -> Plan:
        """Moves on by one tick; plans 3 s of constant acceleration [m/s2] below `limits` (M,) [m/s], no reversing."""
        stations: list[float] = []
        s, speed = self.s, self.speed
        for _ in range(PLAN_POINTS):
            s, speed = _moved(s, speed, acceleration, limits, PLAN_INTERVAL_S)
            stations.append(s)
        self.s, self.speed = _moved(self.s, self.speed, acceleration, limits, tick_s)
        return Plan(self.path.points(np.array(stations)), PLAN_INTERVAL_S)


def _moved(s: float, speed: float, acceleration: float, limits: Float, dt: float) -> tuple[float, float]:
    limit = float(limits[min(int(s / SPACING_M), len(limits) - 1)])
    after = min(max(speed + acceleration * dt, 0.0), limit)
    return s + (speed + after) / 2 * dt, after
