"""Comfort of the CAVs, with the bounds of nuPlan: informative, no part of any score."""

import math
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scoring.metrics.metric import ScalarMetric


@dataclass(frozen=True, slots=True)
class ComfortBounds:
    """Bounds of the metric `ego_is_comfortable` of nuPlan (Karnchanachari et al., 2024; nuplan-devkit 1.2)."""

    min_longitudinal_acceleration: float = -4.05
    """[m/s2]"""
    max_longitudinal_acceleration: float = 2.40
    """[m/s2]"""
    max_lateral_acceleration: float = 4.89
    """Absolute [m/s2]."""
    max_yaw_rate: float = 0.95
    """Absolute [rad/s]."""
    max_yaw_acceleration: float = 1.93
    """Absolute [rad/s2]."""
    max_longitudinal_jerk: float = 4.13
    """Absolute [m/s3]."""
    max_jerk: float = 8.37
    """Absolute change of the magnitude of acceleration [m/s3]."""


BOUNDS = ComfortBounds()
HALF_WINDOW = 7
"""A derivative is the slope of the parabola that is fitted to 15 ticks (Savitzky-Golay, as nuPlan does): 0.75 s."""
_OFFSETS = np.arange(-HALF_WINDOW, HALF_WINDOW + 1, dtype=np.float64)
_WEIGHTS = _OFFSETS / (math.fsum((_OFFSETS * _OFFSETS).tolist()) * DT)


def compute_comfort(episode: EpisodeRecord) -> float | None:
    """Return the share [%] of the CAVs' time in which all bounds hold; None if every CAV is there for under 1.45 s.

    Lateral acceleration is speed times yaw rate, because a recording has no side slip. The first and last 0.7 s of
    each CAV have no second derivative and are left out.
    """
    comfortable = [find_comfortable_ticks(episode, column) for column in range(episode.egos)]
    every = np.concatenate(comfortable)
    return 100.0 * np.count_nonzero(every) / len(every) if len(every) else None


def find_comfortable_ticks(episode: EpisodeRecord, column: int) -> Bool:
    """Return whether all bounds hold, for each tick (n,) of a CAV that has second derivatives."""
    live = episode.valid[:, column]
    speed, yaw = episode.speed[live, column], np.unwrap(episode.yaw[live, column])
    if len(speed) <= 4 * HALF_WINDOW:
        return np.zeros(0, dtype=np.bool_)
    longitudinal, yaw_rate = _differentiate(speed), _differentiate(yaw)
    lateral = speed[HALF_WINDOW:-HALF_WINDOW] * yaw_rate
    jerk = _differentiate(portable.hypot(longitudinal, lateral))
    longitudinal_jerk, yaw_acceleration = _differentiate(longitudinal), _differentiate(yaw_rate)
    inner = slice(HALF_WINDOW, -HALF_WINDOW)
    return (
        (longitudinal[inner] >= BOUNDS.min_longitudinal_acceleration)
        & (longitudinal[inner] <= BOUNDS.max_longitudinal_acceleration)
        & (np.abs(lateral[inner]) <= BOUNDS.max_lateral_acceleration)
        & (np.abs(yaw_rate[inner]) <= BOUNDS.max_yaw_rate)
        & (np.abs(yaw_acceleration) <= BOUNDS.max_yaw_acceleration)
        & (np.abs(longitudinal_jerk) <= BOUNDS.max_longitudinal_jerk)
        & (np.abs(jerk) <= BOUNDS.max_jerk)
    )


def _differentiate(values: Float) -> Float:
    """Return the derivative [1/s] of values (n,) at 20 Hz, (n - 14,): without the ticks whose window is incomplete."""
    windows = np.lib.stride_tricks.sliding_window_view(values, len(_WEIGHTS))
    return portable.dot(windows, _WEIGHTS)


COMFORT = ScalarMetric("comfort", "comfort [%]", lambda scored: compute_comfort(scored.episode), 1)
