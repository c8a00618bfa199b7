"""Plans of constant acceleration along a reference path, for agents without a space-time planner."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import Plan
from mdrive_sumo.contract.exchange import OUR_CONTROLLER
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.planning.reference_path import SPACING_M, ReferencePath


@dataclass(frozen=True, slots=True)
class FollowerParameters:
    """How far the reference may run ahead of the car, and the shape of its plans. Design choices (decision 012)."""

    lead_m: float = 1.0
    """[m] The reference is at most this far from the car."""
    lead_speed: float = 1.5
    """[m/s]"""
    plan_interval_s: float = 0.2
    """Spacing of plan points [s]."""
    plan_points: int = 15
    """3 s with `plan_interval_s`."""


FOLLOWER = FollowerParameters()


class PathFollower:
    """The reference state on a path: arc length s [m] and speed [m/s], advanced from tick to tick.

    A plan that restarted at the measured state in every tick would demand almost nothing of a standing car. The
    reference runs ahead of the car by the lag of its actuators, and never by more than `lead_m` and `lead_speed`, so
    that a car that was stopped by force does not chase it.
    """

    def __init__(self, path: ReferencePath, parameters: FollowerParameters = FOLLOWER) -> None:
        self.path = path
        self.s = 0.0
        self.speed = 0.0
        self.actual_s = 0.0
        self._parameters = parameters

    def replace_path(self, path: ReferencePath) -> None:
        """Continue along another path, which begins as the present one does."""
        x, y = self.path.get_points(np.array((self.actual_s,)))[0].tolist()
        actual_s = path.project(x, y, self.actual_s)
        self.path, self.s, self.actual_s = path, actual_s + (self.s - self.actual_s), actual_s

    def start_at(self, speed: float) -> None:
        """Begin at the measured speed [m/s] instead of a standstill."""
        self.speed = max(speed, 0.0)

    def update(self, x: float, y: float, speed: float) -> None:
        """Keep the reference near the measured box centre [m] and speed [m/s]."""
        lead_m, lead_speed = self._parameters.lead_m, self._parameters.lead_speed
        self.actual_s = self.path.project(x, y, self.actual_s)
        self.s = min(max(self.s, self.actual_s - lead_m), self.actual_s + lead_m)
        self.speed = min(max(self.speed, speed - lead_speed, 0.0), max(speed, 0.0) + lead_speed)

    def advance(self, acceleration: float, limits: Float, tick_s: float) -> Plan:
        """Advance the reference by one tick and return a plan of constant acceleration [m/s2] that never reverses.

        limits: (M,) highest speed [m/s] at the points of the path.
        """
        interval_s, points = self._parameters.plan_interval_s, self._parameters.plan_points
        stations, _ = integrate(limits, self.s, self.speed, acceleration, interval_s, points)
        after, self.speed = integrate(limits, self.s, self.speed, acceleration, tick_s, 1)
        self.s = float(after[0])
        return build_frozen(Plan, self.path.get_points(stations), interval_s, OUR_CONTROLLER)


@twin
def integrate(
    limits: Float, s: float, speed: float, acceleration: float, dt: float, steps: int, /
) -> tuple[Float, float]:
    """Return arc lengths (steps,) [m] after each step of dt [s], and the speed [m/s] after the last one."""
    stations: list[float] = []
    for _ in range(steps):
        limit = float(limits[min(max(int(s / SPACING_M), 0), len(limits) - 1)])
        after = min(max(speed + acceleration * dt, 0.0), limit)
        s, speed = s + (speed + after) / 2 * dt, after
        stations.append(s)
    return np.array(stations, dtype=np.float64), speed
