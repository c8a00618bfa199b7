"""Bounds on how a CAV can drive along its route: speeds, least times and stopping distances.

Every bound is one that a real drive cannot beat: actuators answer at once, curves cost no speed, a lane's whole limit
is used, and the greatest braking includes rolling and air resistance.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scoring.criteria import COMPLETE_PERCENT, GOAL_RADIUS_M
from mdrive_sumo.vehicle.dynamics import AIR_DENSITY, GRAVITY, MKZ_2017

STEP_M = 0.5
"""Spacing of the stations at which speeds are bounded."""
NEAR_LANE_M = 4.0
"""A station has the greatest speed limit of the route's lanes within this distance, so that ends of lanes round up."""


SLOWING = 1.0
"""Deceleration [m/s2] of a CAV that starts above the speed limit, until it keeps it."""


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """What a car can do at most [m/s2]."""

    acceleration: float = MKZ_2017.max_acceleration
    power_per_mass: float = MKZ_2017.max_power / MKZ_2017.mass
    """[W/kg]; bounds the acceleration at higher speeds."""
    deceleration: float = MKZ_2017.max_deceleration + MKZ_2017.rolling_resistance * GRAVITY
    """Greatest deceleration [m/s2]: brakes on a dry road and rolling resistance."""
    drag: float = 0.5 * AIR_DENSITY * MKZ_2017.drag_area / MKZ_2017.mass
    """Deceleration by air resistance per squared speed [1/m]."""

    def compute_deceleration(self, speed: float) -> float:
        """Return the greatest deceleration [m/s2] at up to this speed [m/s]."""
        return self.deceleration + self.drag * speed * speed


@dataclass(frozen=True)
class RouteMotion:
    """All ways to drive a route."""

    line: Polyline
    caps: Float
    """(M,) greatest speed [m/s] from each station to the next, at `STEP_M`."""
    start_speed: float
    limits: MotionLimits

    @cached_property
    def stations(self) -> Float:
        """(M,) stations [m], the first at the start."""
        return np.arange(len(self.caps), dtype=np.float64) * STEP_M

    @cached_property
    def goal_m(self) -> float:
        """Least station [m] at which the route can count as completed."""
        return max(self.line.length * COMPLETE_PERCENT / 100.0, self.line.length - GOAL_RADIUS_M)

    @cached_property
    def top_speed(self) -> float:
        """Greatest speed [m/s] anywhere."""
        return float(self.caps.max())

    @cached_property
    def deceleration(self) -> float:
        """Greatest deceleration [m/s2] at any speed on the route."""
        return self.limits.compute_deceleration(self.top_speed)

    @cached_property
    def fastest(self) -> Float:
        """(M,) greatest speed [m/s] at each station after the start."""
        return self._accelerate(0, self.start_speed)

    @cached_property
    def fastest_times(self) -> Float:
        """(M,) least time [s] from the start to each station."""
        return np.concatenate(((0.0,), np.cumsum(self._step_times(0, self.fastest))))

    def compute_time_to(self, station: float, speed: float) -> float:
        """Return the least time [s] from the start to a station [m], passed at no more than `speed` [m/s]."""
        last = self._index_below(station)
        ahead = self.stations[last] - self.stations[: last + 1]
        braking = np.sqrt(speed * speed + 2.0 * self.deceleration * (ahead + STEP_M))
        return float(self._step_times(0, np.minimum(self.fastest[: last + 1], braking)).sum())

    def compute_time_from(self, station: float, speed: float) -> float:
        """Return the least time [s] from a station [m], passed at `speed` [m/s], to the goal."""
        first = self._index_below(station) + 1
        key = first, speed
        if key not in self._times_from:
            self._times_from[key] = self._compute_time_from(first, speed)
        return self._times_from[key]

    @cached_property
    def _times_from(self) -> dict[tuple[int, float], float]:
        return {}

    def _compute_time_from(self, first: int, speed: float) -> float:
        last = self._index_below(self.goal_m)
        if first >= last:
            return 0.0
        speeds = self._accelerate(first, math.sqrt(speed * speed + 2.0 * self.limits.acceleration * STEP_M))
        return float(self._step_times(first, speeds[: last - first + 1]).sum())

    def compute_reach(self, second: Float) -> Float:
        """Return the greatest station [m] that can be reached after so many seconds, any shape."""
        reach_m = np.interp(second, self.fastest_times, self.stations) + STEP_M
        return np.where(second >= self.fastest_times[-1], self.line.length, reach_m)

    def _index_below(self, station: float) -> int:
        return min(max(int(station / STEP_M), 0), len(self.caps) - 1)

    def _accelerate(self, first: int, speed: float) -> Float:
        """Return the greatest speeds [m/s] at the stations from `first` on, passed at `speed` [m/s]."""
        speeds: list[float] = []
        now, most, power = speed, self.limits.acceleration, self.limits.power_per_mass
        for cap in self.caps[first:].tolist():
            now = min(now, cap)
            speeds.append(now)
            gain = most if now * most < power else power / now
            now = math.sqrt(now * now + 2.0 * gain * STEP_M)
        return np.array(speeds)

    def _step_times(self, first: int, speeds: Float) -> Float:
        """Return the least times [s] between stations, from `first` on, that are passed at these speeds [m/s] at most.

        Within a step a car may accelerate and brake again, but not exceed the limit.
        """
        a, b = self.limits.acceleration, self.deceleration
        v, w = speeds[:-1], speeds[1:]
        peak = np.sqrt(np.maximum(v * v + a * (w * w - v * v + 2.0 * b * STEP_M) / (a + b), 0.0))
        peak = np.maximum(peak, np.maximum(v, w))
        caps = np.maximum(self.caps[first : first + len(v)], self.caps[first + 1 : first + 1 + len(v)])
        return np.maximum((peak - v) / a + (peak - w) / b, STEP_M / caps)


def build_route_motion(ego: Ego, roads: RoadMap, limits: MotionLimits) -> RouteMotion:
    """Return the ways to drive a CAV's route within the speed limits of its lanes."""
    line = Polyline(ego.xy)
    count = int(line.length / STEP_M) + 1
    points = np.array([line.at(s) for s in (np.arange(count) * STEP_M).tolist()])
    caps = _find_caps(points, ego.lanes, roads)
    # A car that starts above the limit may slow down gently.
    slowing = ego.start_speed * ego.start_speed - 2.0 * SLOWING * STEP_M * np.arange(count)
    return RouteMotion(line, np.maximum(caps, np.sqrt(np.maximum(slowing, 0.0))), ego.start_speed, limits)


def _find_caps(points: Float, lanes: Sequence[str], roads: RoadMap) -> Float:
    caps = np.zeros(len(points))
    spots = shapely.points(points)
    lanes_of_route = [roads.lanes[lane] for lane in dict.fromkeys(lanes)]
    for lane in lanes_of_route:
        near = shapely.dwithin(spots, shapely.LineString(lane.centre.xy), NEAR_LANE_M)
        caps = np.where(near, np.maximum(caps, lane.speed_limit), caps)
    return np.where(caps > 0.0, caps, max(lane.speed_limit for lane in lanes_of_route))
