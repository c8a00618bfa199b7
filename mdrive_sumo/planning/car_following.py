"""Distances that vehicles travel: they keep their speed or its trend, and brake behind the vehicle ahead.

A surrogate of SUMO's drivers: the safe speed of Krauss (1998) with SUMO's default deceleration and reaction time.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int


@dataclass(frozen=True, slots=True)
class CarFollowingParameters:
    """Assumed behaviour of background vehicles. Values are SUMO's defaults or design choices."""

    deceleration: float = 4.5
    """[m/s2] With which a vehicle expects to brake (SUMO's default)."""
    hardest_deceleration: float = 7.0
    """[m/s2]"""
    reaction_s: float = 1.0
    """Time gap behind the vehicle ahead (SUMO's default tau)."""
    min_gap_m: float = 2.5
    """Gap when both stand (SUMO's default)."""
    max_acceleration: float = 2.6
    """[m/s2] (SUMO's default)."""
    speeding_up: float = 0.6
    """[m/s2] A vehicle that accelerates by more goes on doing so: SUMO's drivers dawdle by less."""
    stopping: float = -2.0
    """[m/s2] A vehicle that brakes harder is about to stop."""
    step_s: float = 0.25
    """[s] Of the integration."""


FOLLOWING = CarFollowingParameters()


class VehiclesAhead(NamedTuple):
    """The vehicle ahead of each of N vehicles; all arrays are (N,)."""

    row: Int
    """-1 for none."""
    gap_m: Float
    """From the front to the rear of the one ahead."""


class Travel(NamedTuple):
    """What N vehicles do until T times; both arrays are (T, N)."""

    distance: Float
    """[m]"""
    speed: Float
    """[m/s]"""


def find_vehicles_ahead(along: Float, is_ahead: Bool, length: Float) -> VehiclesAhead:
    """Return the nearest vehicle ahead of each of M vehicles; those without a row in `along` have none.

    along: (N, M) distance [m] of the centre of j before the centre of i, N <= M; is_ahead: (N, M) whether j is in the
    lane of i, before it; length: (M,) [m].
    """
    row, gap = np.full(len(length), -1), np.full(len(length), np.inf)
    count = len(along)
    if not count:
        return VehiclesAhead(row, gap)
    distance = np.where(is_ahead, along, np.inf)
    nearest = distance.argmin(axis=1)
    least = distance[np.arange(count), nearest]
    row[:count] = np.where(np.isfinite(least), nearest, -1)
    gap[:count] = least - (length[:count] + length[nearest]) / 2
    return VehiclesAhead(row, gap)


@twin
def predict_travel(
    speed: Float,
    acceleration: Float,
    ahead: VehiclesAhead,
    top_speed: float,
    times: Float,
    parameters: CarFollowingParameters = FOLLOWING,
    /,
) -> Travel:
    """Return the travel of N vehicles until `times` (T,) [s].

    speed, acceleration: (N,) [m/s], [m/s2] as observed; top_speed: [m/s] to which vehicles accelerate.
    """
    trend = _find_trend(acceleration, parameters)
    step_s, brake = parameters.step_s, parameters.deceleration
    expected = brake * parameters.reaction_s
    steps = int(np.ceil(float(times.max(initial=0.0)) / step_s)) + 1
    distance, speeds = np.zeros((steps + 1, len(speed))), np.zeros((steps + 1, len(speed)))
    speeds[0] = now = np.maximum(speed, 0.0)
    highest = np.maximum(top_speed, now)
    follows, leader = ahead.row >= 0, np.maximum(ahead.row, 0)
    gap_m = np.where(follows, ahead.gap_m - parameters.min_gap_m, 0.0)
    for step in range(steps):
        gap = gap_m + distance[step, leader] - distance[step]
        room = np.maximum(gap, 0.0)
        lead = now[leader]
        safe = np.sqrt(expected * expected + lead * lead + 2 * brake * room) - expected
        safe = np.where(follows, safe, np.inf)
        wanted = np.clip(now + trend * step_s, 0.0, highest)
        least = np.maximum(now - parameters.hardest_deceleration * step_s, 0.0)
        after = np.minimum(wanted, np.maximum(safe, least))
        distance[step + 1] = distance[step] + (now + after) / 2 * step_s
        speeds[step + 1] = now = after
    return Travel(_interpolate(distance, times / step_s), _interpolate(speeds, times / step_s))


def _find_trend(acceleration: Float, parameters: CarFollowingParameters) -> Float:
    """Return the accelerations (N,) [m/s2] that last."""
    lasting = (acceleration > parameters.speeding_up) | (acceleration < parameters.stopping)
    return np.where(lasting, np.clip(acceleration, -9.0, parameters.max_acceleration), 0.0)


def _interpolate(values: Float, at: Float) -> Float:
    """Return rows (T, N) of values (K, N) at fractional rows `at` (T,)."""
    low = np.clip(at.astype(np.int64), 0, len(values) - 2)
    share = (at - low)[:, None]
    return values[low] * (1 - share) + values[low + 1] * share
