"""Car following as a log shows it: time headway, standing gap, acceleration, deceleration."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.scenario.background import CarFollowing
from real2sim.fit.background_vehicle import RoutedTrack
from real2sim.tracks.kinematics import compute_derivative

REACH_M = 60.0
"""Leaders further ahead are not followed."""
MOVING, STANDING = 2.0, 0.3
"""[m/s] Faster than the first a time gap means something; slower than the second is standing."""
TAU_S = (0.2, 2.0)
MIN_GAP_M = (0.3, 2.5)
ACCEL, DECEL = (2.6, 8.0), (4.5, 9.0)
"""Bounds. A log of seconds shows less than a driver can: never below SUMO's defaults for passenger cars."""
SHARE = 5.0
"""Percentile of gaps that counts as the shortest a driver keeps."""


def estimate_driving(drivers: Sequence[RoutedTrack], dt_s: float) -> list[CarFollowing]:
    """Parameters of every driver, so that its model never asks for more room than it took in the log."""
    lanes, s = _places(drivers)
    return [_driving(drivers, k, lanes, s, dt_s) for k in range(len(drivers))]


def _places(drivers: Sequence[RoutedTrack]) -> tuple[Int, Float]:
    """Lane number (K, T), -1 where none, and arc length (K, T) [m] in all lanes that occur."""
    numbers = {"": -1}
    for one in drivers:
        for lane in one.match.lanes:
            numbers.setdefault(lane, len(numbers) - 1)
    lanes = np.array([[numbers[lane] for lane in one.match.lanes] for one in drivers], dtype=np.int64)
    return lanes, np.array([one.match.s for one in drivers])


def _driving(drivers: Sequence[RoutedTrack], k: int, lanes: Int, s: Float, dt_s: float) -> CarFollowing:
    one = drivers[k]
    speed = np.gradient(one.progress, dt_s) if len(one.progress) > 1 else np.zeros_like(one.progress)
    gaps = _gaps(drivers, k, lanes, s)
    standing = gaps[(speed < STANDING) & np.isfinite(gaps)]
    close = min(_low(standing, MIN_GAP_M[1]), _low(gaps[np.isfinite(gaps)], MIN_GAP_M[1]))
    min_gap = float(np.clip(close, *MIN_GAP_M))
    follows = (speed > MOVING) & np.isfinite(gaps)
    tau = float(np.clip(_low((gaps[follows] - min_gap) / speed[follows], 1.0), *TAU_S))
    seen = one.progress[np.isfinite(one.progress)]
    force = compute_derivative(seen, dt_s, 2)
    up, down = (float(np.percentile(a, 98)) if len(a) else 0.0 for a in (force, -force))
    return CarFollowing(
        tau_s=round(tau, 2),
        min_gap_m=round(min_gap, 2),
        accel=round(float(np.clip(1.2 * up, *ACCEL)), 2),
        decel=round(float(np.clip(1.2 * down, *DECEL)), 2),
        sigma=0.0,
    )


def _gaps(drivers: Sequence[RoutedTrack], k: int, lanes: Int, s: Float) -> Float:
    """Bumper to bumper distance (T,) [m] to the next vehicle on the lanes of one's route; NaN without any."""
    one = drivers[k]
    begins = np.full((int(lanes.max()) + 2,), np.nan)
    by_name = {lane: number for row, other in zip(lanes, drivers, strict=True)
               for number, lane in zip(row.tolist(), other.match.lanes, strict=True)}  # fmt: skip
    for stage in one.path.edges_in_order:
        for lane in stage.lanes:
            if lane.id in by_name:
                begins[by_name[lane.id]] = stage.begin
    begins[-1] = np.nan
    ahead = begins[lanes] + s - one.progress[None, :]
    ahead[k] = np.nan
    half = np.array([other.length / 2 for other in drivers])[:, None] + one.length / 2
    ahead = np.where((ahead > 0.5) & (ahead < REACH_M), ahead - half, np.inf)
    nearest = ahead.min(axis=0)
    return np.where(np.isfinite(nearest), np.maximum(nearest, 0.0), np.nan)


def _low(values: Float, otherwise: float) -> float:
    return float(np.percentile(values, SHARE)) if len(values) else otherwise
