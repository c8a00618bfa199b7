"""Car-following parameters observed in a log: time headway, standstill gap, acceleration, deceleration."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.scenario.background import CarFollowing
from real2sim.fit.background_vehicle import RoutedTrack
from real2sim.percentile import compute_percentile
from real2sim.tracks.kinematics import compute_derivative

LEADER_RANGE_M = 60.0
"""[m] Leaders further ahead are not followed."""
MOVING, STANDING = 2.0, 0.3
"""[m/s] A time gap is measured above the first speed; below the second the vehicle is standing."""
TAU_S = (0.2, 2.0)
"""[s] Least and largest time headway that is estimated."""
MIN_GAP_M = (0.3, 2.5)
"""[m] Least and largest gap at a standstill that is estimated; the largest is SUMO's default."""
ACCEL, DECEL = (2.6, 8.0), (4.5, 9.0)
"""Bounds. A log of seconds shows less than a driver is capable of: never below SUMO's defaults for passenger cars."""
GAP_PERCENTILE = 5.0
"""Percentile of gaps that counts as the shortest that a driver keeps."""


def estimate_driving(drivers: Sequence[RoutedTrack], dt_s: float) -> list[CarFollowing]:
    """Return the parameters of every driver, such that its model never needs more room than it took in the log."""
    traffic = _LaneTraffic.from_drivers(drivers)
    return [_estimate_vehicle(traffic, k, dt_s) for k in range(len(drivers))]


@dataclass(frozen=True)
class _LaneTraffic:
    drivers: Sequence[RoutedTrack]
    number_by_lane: Mapping[str, int]
    lanes: Int
    """The number of the lane (K, T), -1 without one."""
    s: Float
    """Arc length on it (K, T) [m]."""

    @classmethod
    def from_drivers(cls, drivers: Sequence[RoutedTrack]) -> "_LaneTraffic":
        numbers = {"": -1}
        for driver in drivers:
            for lane in driver.match.lanes:
                numbers.setdefault(lane, len(numbers) - 1)
        lanes = np.array([[numbers[lane] for lane in driver.match.lanes] for driver in drivers], dtype=np.int64)
        return cls(drivers, numbers, lanes, np.array([driver.match.s for driver in drivers]))


def _estimate_vehicle(traffic: _LaneTraffic, k: int, dt_s: float) -> CarFollowing:
    driver = traffic.drivers[k]
    speed = np.gradient(driver.progress, dt_s) if len(driver.progress) > 1 else np.zeros_like(driver.progress)
    gaps = _compute_gaps(traffic, k)
    standing = gaps[(speed < STANDING) & np.isfinite(gaps)]
    close = min(_low_percentile(standing, MIN_GAP_M[1]), _low_percentile(gaps[np.isfinite(gaps)], MIN_GAP_M[1]))
    min_gap = float(np.clip(close, *MIN_GAP_M))
    follows = (speed > MOVING) & np.isfinite(gaps)
    tau = float(np.clip(_low_percentile((gaps[follows] - min_gap) / speed[follows], 1.0), *TAU_S))
    seen = driver.progress[np.isfinite(driver.progress)]
    force = compute_derivative(seen, dt_s, 2)
    up, down = (compute_percentile(a, 98) if len(a) else 0.0 for a in (force, -force))
    return CarFollowing(
        tau_s=round(tau, 2),
        min_gap_m=round(min_gap, 2),
        accel=round(float(np.clip(1.2 * up, *ACCEL)), 2),
        decel=round(float(np.clip(1.2 * down, *DECEL)), 2),
        sigma=0.0,
    )


def _compute_gaps(traffic: _LaneTraffic, k: int) -> Float:
    """Return the bumper-to-bumper distance (T,) [m] to the next vehicle on the lanes of the route; NaN without one."""
    driver = traffic.drivers[k]
    begins = np.full((int(traffic.lanes.max()) + 2,), np.nan)
    for stage in driver.path.edges_in_order:
        for lane in stage.lanes:
            if lane.id in traffic.number_by_lane:
                begins[traffic.number_by_lane[lane.id]] = stage.begin
    begins[-1] = np.nan
    ahead = begins[traffic.lanes] + traffic.s - driver.progress[None, :]
    ahead[k] = np.nan
    half = np.array([other.length / 2 for other in traffic.drivers])[:, None] + driver.length / 2
    ahead = np.where((ahead > 0.5) & (ahead < LEADER_RANGE_M), ahead - half, np.inf)
    nearest = ahead.min(axis=0)
    return np.where(np.isfinite(nearest), np.maximum(nearest, 0.0), np.nan)


def _low_percentile(values: Float, otherwise: float) -> float:
    return compute_percentile(values, GAP_PERCENTILE) if len(values) else otherwise
