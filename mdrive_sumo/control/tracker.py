"""Our own trajectory tracker: pure pursuit for the wheel, a short deadbeat for the pedals."""

import math

import numpy as np

from mdrive_sumo.contract import Control, Plan, VehicleFacts
from mdrive_sumo.control.plan import Own, in_ego_frame, rounded
from mdrive_sumo.geometry import Float, Polyline, polyline
from mdrive_sumo.state import DT, EgoState

PREVIEW_S = 0.8
"""The car shall be where the plan is in this time [s]; gives the position loop a damping ratio of 0.71."""
LAG_S = 0.1
"""Time [s] until an order works: the plan is compared with the car predicted by so much."""
LOOK_AHEAD_M, LOOK_AHEAD_S, LOOK_AHEAD_S2 = 1.2, 0.1, 0.015
"""Pure pursuit aims 1.2 m + 0.1 s v + 0.015 s2/m v2 ahead: as short as the MKZ stays well damped with, up to 25 m/s."""
COASTING = 0.12
"""Deceleration [m/s2] by rolling resistance alone: a request above it needs no brake."""
HOLD = 0.3
"""Brake while standing."""
COLLAPSED = 0.1
"""A plan shorter than this [m] is one point."""
ENDS = 100.0
"""How far [m] a plan's line is prolonged."""


class Tracker:
    """Follows a plan in space and time.

    Steering is pure pursuit (Coulter 1992) with its geometry written for the box centre instead of the rear axle: the
    centre then runs on the circle through the aimed-at point. Acceleration is the constant one that brings the car to
    the plan's arc length `PREVIEW_S` from now. Plans that end earlier go on with their last speed until their last
    point is due; then the car stops there.
    """

    def __init__(self, vehicle: VehicleFacts) -> None:
        self._vehicle = vehicle

    def follow(self, plan: Plan, own: Own, age_ticks: int) -> Control:
        """See `Controller.follow`."""
        soon = _predicted(own)
        path, stations = _path(plan, own)
        here, _ = path.project(soon.x, soon.y)
        goal = _station(stations, plan.interval_s, age_ticks * DT)
        throttle, brake = self._pedals(soon.speed, goal - here)
        return rounded(throttle, brake, self._steer(path, here, soon))

    def _pedals(self, speed: float, distance: float) -> tuple[float, float]:
        """Throttle and brake that cover the distance [m] within `PREVIEW_S`."""
        if distance < 0.1 and speed < 0.1:
            return 0.0, HOLD
        acceleration = 2 * (distance - speed * PREVIEW_S) / PREVIEW_S**2
        if 2 * distance < speed * PREVIEW_S:  # it would roll back at the end: stop at the distance instead
            acceleration = -speed * speed / (2 * max(distance, 0.01))
        if acceleration > -COASTING:
            return max(0.0, acceleration + COASTING) / self._vehicle.max_acceleration, 0.0
        return 0.0, -(acceleration + COASTING) / self._vehicle.max_deceleration

    def _steer(self, path: Polyline, here: float, own: EgoState) -> float:
        """Share of the full lock that leads the centre through a point ahead on the path."""
        vehicle = self._vehicle
        speed = abs(own.speed)
        ahead = LOOK_AHEAD_M + LOOK_AHEAD_S * speed + LOOK_AHEAD_S2 * speed * speed
        x, y = in_ego_frame(np.array((path.at(here + ahead),)), own)[0].tolist()
        # Circle through centre and aim whose middle lies abeam of the rear axle.
        x += vehicle.rear_to_centre
        curvature = 2 * y / max(x * x + y * y - vehicle.rear_to_centre**2, 1e-3)
        return math.atan(vehicle.wheelbase * curvature) / vehicle.max_steer_angle


def _predicted(own: Own) -> EgoState:
    """The car `LAG_S` from now if nothing changes: where an answer given now begins to work."""
    speed = max(0.0, own.speed + own.acceleration * LAG_S) if own.speed >= 0.0 else own.speed
    way, turn = (own.speed + speed) / 2 * LAG_S, own.yaw_rate * LAG_S
    yaw = own.yaw + turn / 2
    return EgoState(own.x + way * math.cos(yaw), own.y + way * math.sin(yaw), own.yaw + turn, speed)


def _path(plan: Plan, own: Own) -> tuple[Polyline, Float]:
    """The plan's line, prolonged straight at both ends, and the arc length (N,) [m] of its points on it."""
    points = plan.points
    along = np.concatenate(((0.0,), np.cumsum(np.hypot(*np.diff(points, axis=0).T))))
    if along[-1] < COLLAPSED:
        return _path_to(points[-1], len(points), own)
    line = polyline(points).xy
    first, last = line[1] - line[0], line[-1] - line[-2]
    start = line[0] - first * (ENDS / np.hypot(*first))
    end = line[-1] + last * (ENDS / np.hypot(*last))
    return Polyline(np.vstack((start, line, end))), ENDS + along


def _path_to(point: Float, count: int, own: Own) -> tuple[Polyline, Float]:
    """The line to a plan that is one point: towards it, or straight ahead if it is too near or behind.

    The car itself is at arc length `ENDS`.
    """
    x, y = in_ego_frame(point[None], own)[0].tolist()
    distance = math.hypot(x, y) if x > COLLAPSED else x
    yaw = own.yaw + (math.atan2(y, x) if x > COLLAPSED else 0.0)
    here, ahead = np.array((own.x, own.y)), ENDS * np.array((math.cos(yaw), math.sin(yaw)))
    return Polyline(np.array((here - ahead, here + ahead))), np.full(count, ENDS + distance)


def _station(stations: Float, interval_s: float, now_s: float) -> float:
    """Arc length [m] where the plan wants the car `LAG_S` + `PREVIEW_S` from now, when `now_s` seconds have passed.

    Before its first and after its last point a plan has the speed of its first and last hop.
    """
    count, later = len(stations), LAG_S + PREVIEW_S
    if now_s > count * interval_s:
        return float(stations[-1])
    if count == 1:
        return ENDS + float(stations[0] - ENDS) * later / max(interval_s - now_s, DT)
    index = (now_s + later) / interval_s - 1
    if index < 0:
        return float(stations[0] + index * (stations[1] - stations[0]))
    over = max(0.0, index - (count - 1))
    return float(np.interp(index, np.arange(count), stations) + over * (stations[-1] - stations[-2]))
