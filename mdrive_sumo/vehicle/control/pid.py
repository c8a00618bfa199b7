"""The controllers of the paper's baselines, as arithmetic on a plan.

Gains are those of the paper (table of per-baseline controllers). What the table leaves open follows spec/protocol.md
11.1 for `V2xController` and the published code bases for the others (CARLA's PythonAPI agents, TCP/Bench2Drive,
LMDrive). Two differences are common to all: our steer is positive to the left (CARLA: right), and where an original
aims at a route point that it gets from its host, ours aims along its own plan.
"""

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import Control, Plan
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND
from mdrive_sumo.core.window_pid import WindowPid
from mdrive_sumo.vehicle.control.plan_reader import OwnMotion, find_aim_point, round_control, sample_waypoints

RIGHT_ANGLE = math.pi / 2
"""The controllers of the paper's agents steer by the angle to the waypoint as a share of 90 degrees."""


class V2xController:
    """V2X_Controller (CoLMDriver, CoDriving): decides at 5 Hz and holds its answer in between.

    The desired speed is the planned speed times max_speed / 5: x1 for max_speed 5, x1.6 for max_speed 8. That is the
    code's arithmetic (mean of the first three increments of |point| x max_speed at 0.2 s spacing); the paper calls
    max_speed a cap. After 20 s of standing it starts by force. Difference: the original steers to the route's target
    point, 2 to 12 m away; ours to the point `LOOK_AHEAD` m ahead on the plan.
    """

    LOOK_AHEAD = 7.0
    """[m]. With these gains and the MKZ's steering a car then holds a circle without offset (small angles: 7.1 m)."""
    SPACING_S = 0.2
    EVERY = TICKS_PER_SECOND // 5

    def __init__(self, max_speed: float) -> None:
        self._max_speed = max_speed
        self._turn = WindowPid((1.0, 0.2, 0.1), 5)
        self._speed = WindowPid((5.0, 1.0, 0.1), 20)
        self._calls = 0
        self._stood = 0
        self._forced = 0
        self._last = round_control(0.0, 0.0, 0.0)

    def follow(self, plan: Plan, own: OwnMotion, age_ticks: int) -> Control:
        """See `Controller.follow`."""
        if self._calls % self.EVERY == 0:
            self._last = self._decide(plan, own, age_ticks)
        self._calls += 1
        return self._last

    def _decide(self, plan: Plan, own: OwnMotion, age_ticks: int) -> Control:
        x, y = find_aim_point(plan, own, age_ticks, self.LOOK_AHEAD)
        steer = self._turn(portable.atan2(y, x) / RIGHT_ANGLE if own.speed >= 0.01 else 0.0)
        ranges = portable.hypot(*sample_waypoints(plan, own, age_ticks, self.SPACING_S, 4).T)
        desired = float(np.diff(ranges).mean()) * self._max_speed
        throttle = min(0.75, self._speed(max(0.0, min(0.35, desired - own.speed))))
        brake = own.speed > 1.1 * desired
        if self._starts_by_force(own.speed):
            return round_control(0.8, 0.0, steer)
        return round_control(0.0 if brake else throttle, float(brake), steer)

    def _starts_by_force(self, speed: float) -> bool:
        self._stood = self._stood + 1 if speed < 0.2 else max(0, self._stood - 10)
        if self._stood > 100:
            self._stood, self._forced = 0, 12
        self._forced -= 1
        return self._forced >= 0


class CarlaPid:
    """VehiclePIDController of CARLA's agents (perception-swap 21.6 km/h, human-in-the-loop 28.8 km/h), 20 Hz.

    Errors are km/h and radians, integrals and derivatives take the tick as time step over the last 10 errors, and the
    wheel turns at most 0.1 a call. Aims 3 m + 0.5 s x speed ahead, as CARLA's LocalPlanner. Difference: the original
    drives at the fixed speed and leaves stopping to its host; ours never exceeds the plan's speed of the next second.
    """

    def __init__(self, target_kmh: float) -> None:
        self._target_kmh = target_kmh
        self._speed_errors: deque[float] = deque(maxlen=10)
        self._turn_errors: deque[float] = deque(maxlen=10)
        self._steer = 0.0

    def follow(self, plan: Plan, own: OwnMotion, age_ticks: int) -> Control:
        """See `Controller.follow`."""
        planned = float(portable.hypot(*sample_waypoints(plan, own, age_ticks, 1.0, 1)[0]))
        error = min(self._target_kmh, 3.6 * planned) - 3.6 * own.speed
        pedal = _timed_pid(self._speed_errors, error, (5.0, 1.0, 0.1))
        x, y = find_aim_point(plan, own, age_ticks, 3.0 + 0.5 * max(0.0, own.speed))
        steer = _timed_pid(self._turn_errors, portable.atan2(y, x), (0.5, 0.05, 0.2))
        steer = max(self._steer - 0.1, min(self._steer + 0.1, steer))
        self._steer = max(-0.8, min(0.8, steer))
        return round_control(min(0.75, pedal), min(0.5, -pedal), self._steer)


def _timed_pid(errors: deque[float], error: float, gains: tuple[float, float, float]) -> float:
    """P e + I sum(window) dt + D de/dt, limited to [-1, 1]; the first error has no I and D."""
    errors.append(error)
    if len(errors) < 2:
        return max(-1.0, min(1.0, gains[0] * error))
    integral, derivative = math.fsum(errors) * DT, (errors[-1] - errors[-2]) / DT
    return max(-1.0, min(1.0, gains[0] * error + gains[1] * integral + gains[2] * derivative))


@dataclass(frozen=True, slots=True)
class DualPidParameters:
    """Parameters in which UniAD's and VAD's controller differ from LMDrive's."""

    turn_gains: tuple[float, float, float]
    aim_m: float | None
    """Aims at the waypoint that lies about so far away [m]; None: between the first two."""
    waypoints: int
    """How many waypoints, 0.5 s apart, make the desired speed."""
    brake_speed: float
    """Below this desired speed [m/s] it brakes."""
    most_error: float
    """Most speed error [m/s] that the throttle sees."""


B2D = DualPidParameters((0.75, 0.75, 0.3), aim_m=4.0, waypoints=6, brake_speed=0.4, most_error=0.25)
LMDRIVE = DualPidParameters((1.25, 0.75, 0.3), aim_m=None, waypoints=2, brake_speed=0.1, most_error=0.35)


class DualPid:
    """Two windowed PIDs on 0.5 s waypoints, binary brake, 20 Hz: PIDController_b2d (UniAD, VAD) and LMDrive's."""

    SPACING_S = 0.5

    def __init__(self, setting: DualPidParameters) -> None:
        self._setting = setting
        self._turn = WindowPid(setting.turn_gains, 40)
        self._speed = WindowPid((5.0, 0.5, 1.0), 40)

    def follow(self, plan: Plan, own: OwnMotion, age_ticks: int) -> Control:
        """See `Controller.follow`."""
        setting = self._setting
        points = sample_waypoints(plan, own, age_ticks, self.SPACING_S, setting.waypoints)
        x, y = self._aim(points).tolist()
        steer = self._turn(portable.atan2(y, x) / RIGHT_ANGLE if own.speed >= 0.01 else 0.0)
        desired = float(portable.hypot(*np.diff(points, axis=0).T).mean()) / self.SPACING_S
        brake = desired < setting.brake_speed or own.speed > 1.1 * desired
        throttle = min(0.75, self._speed(max(0.0, min(setting.most_error, desired - own.speed))))
        return round_control(0.0 if brake else throttle, float(brake), steer)

    def _aim(self, points: Float) -> Float:
        middles = (points[1:] + points[:-1]) / 2
        if self._setting.aim_m is None:
            return middles[0]
        return points[np.argmin(np.abs(portable.hypot(*middles.T) - self._setting.aim_m))]
