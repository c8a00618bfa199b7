"""Our own trajectory tracker: pure pursuit for the wheel, a short deadbeat for the pedals."""

import math
from bisect import bisect
from operator import itemgetter

from mdrive_sumo.contract import Control, Plan, VehicleFacts
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.state import DT, EgoState
from mdrive_sumo.vehicle.control.plan_reader import OwnMotion, point_to_ego_frame, round_control

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
DISTINCT = 1e-6
"""A hop shorter than this [m] has no direction."""
ENDS = 100.0
"""How far [m] a plan's line is prolonged."""
HORIZON_S, HORIZON_M = 3.0, 20.0
"""How much of a plan is looked at: what is due so soon, and at least so far."""

Hop = tuple[float, float, float, float, float, float]
"""A straight piece of line: arc length [m] at its start, its start x, y [m], unit vector along it, length [m]."""


class Tracker:
    """Follows a plan in space and time.

    Steering is pure pursuit (Coulter 1992) with its geometry written for the box centre instead of the rear axle: the
    centre then runs on the circle through the aimed-at point. Acceleration is the constant one that brings the car to
    the plan's arc length `PREVIEW_S` from now. Plans that end earlier go on with their last speed until their last
    point is due; then the car stops there.
    """

    def __init__(self, vehicle: VehicleFacts) -> None:
        self._vehicle = vehicle

    def follow(self, plan: Plan, own: OwnMotion, age_ticks: int) -> Control:
        """See `Controller.follow`."""
        return follow_plan(plan, own, age_ticks, self._vehicle)


@twin
def follow_plan(plan: Plan, own: OwnMotion, age_ticks: int, vehicle: VehicleFacts, /) -> Control:
    """See `Tracker`, which has no state."""
    soon = _predict_motion(own)
    stations, hops = _build_line(plan, own, age_ticks * DT)
    here = _project_on_line(hops, soon.x, soon.y)
    goal = _find_station(stations, plan.interval_s, age_ticks * DT)
    throttle, brake = _choose_pedals(soon.speed, goal - here, vehicle)
    return round_control(throttle, brake, _choose_steer(hops, here, soon, vehicle))


def _predict_motion(own: OwnMotion) -> EgoState:
    """The car `LAG_S` from now if nothing changes: where an answer given now begins to work."""
    speed = max(0.0, own.speed + own.acceleration * LAG_S) if own.speed >= 0.0 else own.speed
    driven_m, turn = (own.speed + speed) / 2 * LAG_S, own.yaw_rate * LAG_S
    yaw = own.yaw + turn / 2
    cos, sin = portable.cos_sin(yaw)
    return EgoState(own.x + driven_m * cos, own.y + driven_m * sin, own.yaw + turn, speed)


def _build_line(plan: Plan, own: OwnMotion, now_s: float) -> tuple[list[float], list[Hop]]:
    """Arc length [m] of the plan's points, repeated ones too, and the line through them, prolonged at both ends.

    It ends where nothing that comes matters yet: beyond both `HORIZON_S` from now and `HORIZON_M`.
    """
    points: list[list[float]] = plan.points.tolist()
    s, (x, y) = 0.0, points[0]
    stations, hops = [s], []
    enough = (now_s + HORIZON_S) / plan.interval_s
    for u, v in points[1:]:
        length = portable.hypot(u - x, v - y)
        if length > DISTINCT:
            hops.append((s, x, y, (u - x) / length, (v - y) / length, length))
            s, x, y = s + length, u, v
        stations.append(s)
        if s > HORIZON_M and len(stations) > enough:
            break
    if s < COLLAPSED:
        return _build_line_to_point(x, y, len(stations), own)
    start, x, y, ux, uy, length = hops[0]
    hops[0] = start - ENDS, x - ENDS * ux, y - ENDS * uy, ux, uy, length + ENDS
    hops[-1] = *hops[-1][:5], hops[-1][5] + ENDS
    return stations, hops


def _build_line_to_point(x: float, y: float, count: int, own: OwnMotion) -> tuple[list[float], list[Hop]]:
    """As `_build_line`, of a plan that is one point: towards it, or straight ahead if it is too near or behind.

    The car itself is at arc length 0.
    """
    ahead, left = point_to_ego_frame(x, y, own)
    distance = portable.hypot(ahead, left) if ahead > COLLAPSED else ahead
    yaw = own.yaw + (portable.atan2(left, ahead) if ahead > COLLAPSED else 0.0)
    cos, sin = portable.cos_sin(yaw)
    return [distance] * count, [(-ENDS, own.x - ENDS * cos, own.y - ENDS * sin, cos, sin, 2 * ENDS)]


def _project_on_line(hops: list[Hop], x: float, y: float) -> float:
    """Arc length [m] of the point of the line that is nearest to (x, y)."""
    least, here = math.inf, 0.0
    for start, px, py, ux, uy, length in hops:
        dx, dy = x - px, y - py
        along, aside = dx * ux + dy * uy, dx * uy - dy * ux
        on = 0.0 if along < 0.0 else length if along > length else along
        gap = aside * aside + (along - on) * (along - on)
        if gap < least:
            least, here = gap, start + on
    return here


def _find_station(stations: list[float], interval_s: float, now_s: float) -> float:
    """Arc length [m] where the plan wants the car `LAG_S` + `PREVIEW_S` from now, when `now_s` seconds have passed.

    Before its first and after its last point a plan has the speed of its first and last hop.
    """
    count, later = len(stations), LAG_S + PREVIEW_S
    if now_s > count * interval_s:
        return stations[-1]
    if count == 1:
        return stations[0] * later / max(interval_s - now_s, DT)
    index = (now_s + later) / interval_s - 1
    hop = min(max(int(index), 0), count - 2)
    return stations[hop] + (index - hop) * (stations[hop + 1] - stations[hop])


def _choose_pedals(speed: float, distance: float, vehicle: VehicleFacts) -> tuple[float, float]:
    """Throttle and brake that cover the distance [m] within `PREVIEW_S`."""
    if distance < 0.1 and speed < 0.1:
        return 0.0, HOLD
    acceleration = 2 * (distance - speed * PREVIEW_S) / (PREVIEW_S * PREVIEW_S)
    if 2 * distance < speed * PREVIEW_S:  # it would roll back at the end: stop at the distance instead
        acceleration = -speed * speed / (2 * max(distance, 0.01))
    if acceleration > -COASTING:
        return max(0.0, acceleration + COASTING) / vehicle.max_acceleration, 0.0
    return 0.0, -(acceleration + COASTING) / vehicle.max_deceleration


def _choose_steer(hops: list[Hop], here: float, own: EgoState, vehicle: VehicleFacts) -> float:
    """Share of the full lock that leads the centre through a point ahead on the line."""
    speed = abs(own.speed)
    target = here + LOOK_AHEAD_M + LOOK_AHEAD_S * speed + LOOK_AHEAD_S2 * speed * speed
    start, px, py, ux, uy, _ = hops[max(bisect(hops, target, key=itemgetter(0)) - 1, 0)]
    x, y = point_to_ego_frame(px + (target - start) * ux, py + (target - start) * uy, own)
    # Circle through centre and aim whose middle lies abeam of the rear axle.
    x += vehicle.rear_to_centre
    curvature = 2 * y / max(x * x + y * y - vehicle.rear_to_centre * vehicle.rear_to_centre, 1e-3)
    return portable.atan(vehicle.wheelbase * curvature) / vehicle.max_steer_angle
