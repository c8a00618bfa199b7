"""The path that a built-in agent drives.

A route is a chain of 1 m points. The reference path is the same line, smoothed, extended beyond the goal and sampled
densely, with its curvature and the heading of the car's body along it.
"""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from mdrive_sumo.contract import Briefing, Cause, Reason
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline, wrap_angle

SPACING_M = 0.25
"""Distance between the points of a path; a cell of the space-time lattice (`speed_profile`)."""


@dataclass(frozen=True, slots=True)
class PathParameters:
    """How a route becomes a reference path. Values are design choices (decision 012)."""

    run_out_m: float = 10.0
    """The path continues beyond the goal, so that a car passes it at speed: a route is completed by passing its end."""
    smoothing_m: float = 2.0
    """Half width of the moving average that rounds kinks of lane geometry; cuts a 6 m bend by 4 / (6 · 6) = 0.11 m."""
    aligned_rad: float = 0.15
    """A route that leaves at a larger angle to the car's heading is blended into that heading."""
    join_m: float = 16.0
    """Length of that blend."""


PATH = PathParameters()
LOOK_AHEAD_S = 4.0
"""[s] A route that slows a car further ahead, at its cruising speed, is no reason for what it does now."""
NOTICEABLE_SPEED = 0.5
"""[m/s] A route that takes less off the cruising speed does not limit it: half a step of the finest lattice."""


class PathState(NamedTuple):
    """Where on a path a car is, and how fast."""

    s: float
    """Arc length [m]."""
    speed: float
    """[m/s] Along the path."""


@dataclass(frozen=True)
class ReferencePath:
    """A path sampled every `SPACING_M`: the arc length of point i is i · SPACING_M. All arrays have M rows."""

    xy: Float
    """(M, 2) box centres [m]."""
    yaw: Float
    """Direction of the path [rad], unwrapped."""
    curvature: Float
    """[1/m], left positive."""
    goal_s: float
    """Arc length of the route's end [m]."""
    rear_to_centre: float
    """Distance of the box centre before the rear axle [m]."""
    start_yaw: float | None = None
    """Heading of the body at the first point [rad]; None: that of the path."""

    @cached_property
    def body_yaw(self) -> Float:
        """Heading (M,) of the car's body [rad]: the rear axle follows, so it turns later than the path of the centre.

        Computed when it is first read: most candidates for a detour are rejected before.
        """
        return _compute_body_yaw(self.yaw, self.rear_to_centre, self.start_yaw)

    @property
    def length(self) -> float:
        """Arc length of the last point [m]."""
        return (len(self.xy) - 1) * SPACING_M

    def get_points(self, s: Float) -> Float:
        """Return the points (K, 2) at arc lengths s (K,); beyond the end the last point."""
        return interpolate_points(self.xy, s)

    def project(self, x: float, y: float, near_s: float, within_m: float = 10.0) -> float:
        """Return the arc length [m] of the point nearest to (x, y), within `within_m` of `near_s` along the path."""
        return project_on_points(self.xy, self.yaw, x, y, near_s, within_m)


@twin
def interpolate_points(xy: Float, s: Float, /) -> Float:
    """As `ReferencePath.get_points`, of the points xy (M, 2)."""
    index, grid = s / SPACING_M, np.arange(len(xy))
    return np.column_stack([np.interp(index, grid, xy[:, axis]) for axis in (0, 1)])


@twin
def project_on_points(xy: Float, yaw: Float, x: float, y: float, near_s: float, within_m: float, /) -> float:
    """As `ReferencePath.project`, on the points xy (M, 2) with directions yaw (M,)."""
    high = min(max(int((near_s + within_m) / SPACING_M) + 2, 1), len(xy))
    low = min(max(int((near_s - within_m) / SPACING_M), 0), high - 1)
    dx, dy = x - xy[low:high, 0], y - xy[low:high, 1]
    i = low + int((dx * dx + dy * dy).argmin())
    cos, sin = portable.cos_sin(float(yaw[i]))
    along = cos * (x - float(xy[i, 0])) + sin * (y - float(xy[i, 1]))
    return min(max(i * SPACING_M + along, 0.0), (len(xy) - 1) * SPACING_M)


def build_path(
    route_xy: Float, rear_to_centre: float, start_yaw: float | None = None, parameters: PathParameters = PATH
) -> ReferencePath:
    """Return the path of a route (N, 2) [m] for a car whose box centre lies `rear_to_centre` [m] before its rear axle.

    start_yaw: heading of the car [rad]; where the route leaves at an angle to it (a lane change from the first metre
    on) the path begins straight and joins the route within `join_m`.
    """
    route = build_polyline(route_xy)
    if start_yaw is not None and abs(wrap_angle(float(route.yaws[0]) - start_yaw)) > parameters.aligned_rad:
        route = _blend_into_heading(route, start_yaw, parameters.join_m)
    smoothing_m = parameters.smoothing_m
    ends = [route.at(-smoothing_m), *route.xy, route.at(route.length + parameters.run_out_m + smoothing_m)]
    fine = build_polyline(ends).resample(SPACING_M).xy
    half = round(smoothing_m / SPACING_M)
    smooth = sliding_window_view(fine, 2 * half + 1, axis=0).mean(axis=-1)
    xy = build_polyline(smooth).resample(SPACING_M).xy[:-1]
    goal_s = build_polyline(xy).project(*route.xy[-1].tolist())[0]
    return build_path_through_points(xy, rear_to_centre, start_yaw, goal_s)


def build_path_through_points(
    xy: Float, rear_to_centre: float, start_yaw: float | None, goal_s: float
) -> ReferencePath:
    """Return the path through smooth points xy (M, 2) [m] that are `SPACING_M` apart."""
    yaw = np.unwrap(portable.atan2(np.gradient(xy[:, 1]), np.gradient(xy[:, 0])))
    return ReferencePath(xy, yaw, _compute_curvature(yaw), goal_s, rear_to_centre, start_yaw)


def _blend_into_heading(route: Polyline, start_yaw: float, join_m: float) -> Polyline:
    """Return the route with its beginning bent towards the straight line along `start_yaw` [rad]."""
    s = np.minimum(route.s, join_m)[:, None]
    straight = route.xy[0] + s * np.array(portable.cos_sin(start_yaw))
    share = s / join_m
    weight = (share * share) * (3 - 2 * share)
    return build_polyline(straight * (1 - weight) + route.xy * weight)


def _compute_curvature(yaw: Float) -> Float:
    """Return the change of direction over the 2 m around each point: a car drives a kink as a bend of that length."""
    reach = round(1.0 / SPACING_M)
    padded = np.concatenate((np.full(reach, yaw[0]), yaw, np.full(reach, yaw[-1])))
    return (padded[2 * reach :] - padded[: -2 * reach]) / (2 * reach * SPACING_M)


def _compute_body_yaw(yaw: Float, rear_to_centre: float, start_yaw: float | None) -> Float:
    first = float(yaw[0])
    return integrate_body_yaw(
        yaw, rear_to_centre, first if start_yaw is None else first + wrap_angle(start_yaw - first)
    )


@twin
def integrate_body_yaw(yaw: Float, rear_to_centre: float, first: float, /) -> Float:
    """Integrate the kinematic single-track model from a body yaw on: d body / ds = sin(yaw - body) / rear_to_centre."""
    body = [first]
    for direction in yaw[:-1].tolist():
        body.append(body[-1] + SPACING_M * portable.sin(direction - body[-1]) / rear_to_centre)
    return np.array(body)


def compute_curve_speeds(
    path: ReferencePath, cruise_speed: float, lateral: float, braking: float, legal: Float | None = None
) -> Float:
    """Return the highest speed (M,) [m/s] at each point that keeps to `cruise_speed`, `lateral`, `braking` [m/s2].

    legal: (M,) speed limits [m/s] at the points, which hold too. A lower one holds where it begins: the speeds before
    it let a car brake in time, as before a bend.
    """
    bend = np.minimum(cruise_speed, np.sqrt(lateral / np.maximum(np.abs(path.curvature), 1e-6)))
    return limit_to_braking(bend if legal is None else np.minimum(bend, legal), braking)


@twin
def limit_to_braking(limits: Float, braking: float, /) -> Float:
    """Return the speeds (M,) [m/s] from which a car keeps to all later limits (M,) with `braking` [m/s2]."""
    speeds = limits.tolist()
    for i in range(len(speeds) - 2, -1, -1):
        speeds[i] = min(speeds[i], math.sqrt(portable.square(speeds[i + 1]) + 2 * braking * SPACING_M))
    return np.array(speeds)


@dataclass(frozen=True)
class RouteSpeeds:
    """How fast a car drives along a path on a free road, and what limits it."""

    limits: Float
    """(M,) legal and comfortable speed [m/s] at the points of the path."""
    cruise_speed: float
    """[m/s] Where nothing of the route limits it."""
    legal: Float | None
    """(M,) speed limit [m/s]; None if the car does not mind it."""

    @classmethod
    def compute(
        cls, path: ReferencePath, cruise_speed: float, lateral: float, braking: float, legal: Float | None
    ) -> "RouteSpeeds":
        """Return the speeds of `compute_curve_speeds`."""
        return cls(compute_curve_speeds(path, cruise_speed, lateral, braking, legal), cruise_speed, legal)

    def find_reason(self, s: float) -> Reason:
        """Return what of the route limits the speed from arc length s [m] on, within `LOOK_AHEAD_S`."""
        first = min(max(int(s / SPACING_M), 0), len(self.limits) - 1)
        slowest = find_slowest(self.limits, first, int(self.cruise_speed * LOOK_AHEAD_S / SPACING_M) + 1)
        speed = float(self.limits[slowest])
        if speed > self.cruise_speed - NOTICEABLE_SPEED:
            return build_frozen(Reason, Cause.FREE, (), None, None, None, self.cruise_speed)
        is_legal = self.legal is not None and float(self.legal[slowest]) < speed + NOTICEABLE_SPEED
        cause = Cause.SPEED_LIMIT if is_legal else Cause.BEND
        return Reason(cause, distance_m=(slowest - first) * SPACING_M, speed=speed)


@twin
def find_slowest(limits: Float, first: int, count: int, /) -> int:
    """Return the index of the lowest of `count` limits from index `first` on; of equal ones the first."""
    return first + int(limits[first : first + count].argmin())


def compute_legal_speeds(path: ReferencePath, briefing: Briefing) -> Float:
    """Return the speed limit (M,) [m/s] of the route at the points of the path, from the point on where it begins."""
    return interpolate_legal_speeds(path, briefing.route_s, briefing.route_speed_limit)


def interpolate_legal_speeds(path: ReferencePath, route_s: Float, limits: Float) -> Float:
    """As `compute_legal_speeds`, of limits (N,) [m/s] at arc lengths (N,) [m] of a route."""
    return np.interp(np.arange(len(path.xy)) * SPACING_M, route_s, limits)


def convert_route_station(path: ReferencePath, briefing: Briefing, route_s: float) -> float:
    """Return the arc length [m] on the path (smoother, so shorter) of an arc length on the route."""
    x, y = (float(np.interp(route_s, briefing.route_s, briefing.route_xy[:, axis])) for axis in (0, 1))
    return path.project(x, y, route_s)
