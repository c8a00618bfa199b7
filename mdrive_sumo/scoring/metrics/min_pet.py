"""Minimum post-encroachment time of an episode: informative, no part of any score."""

import math
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import DT
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scoring.metrics.metric import ScalarMetric

STRIDE = 2
"""Ticks between the compared frames: the result is a multiple of 0.1 s."""
HORIZON_S = 5.0
"""Greatest post-encroachment time [s] that is reported; conflicts are counted up to about 5 s in the literature."""
LAGS = round(HORIZON_S / (STRIDE * DT))
MIN_TURN = math.radians(30.0)
"""Least difference of directions [rad]. One road user behind another on the same path has a gap, not a conflict."""


class _Frames(NamedTuple):
    """Every second frame of an episode: S frames of M road users, CAVs first."""

    x: Float
    y: Float
    yaw: Float
    """(S, M) [rad], as x and y in [m]."""
    valid: Bool
    length: Float
    width: Float
    """(M,) [m]"""


def compute_min_pet(episode: EpisodeRecord) -> float | None:
    """Return the least post-encroachment time [s] over all pairs with a CAV; None if none is within 5 s.

    It is the time from when one leaves a place until the other takes it (Allen, Shin, Cooper 1978): the least time
    between two frames in which the boxes of both overlap, in directions that differ by 30 degrees or more. 0 is a
    collision. Road users that never move are left out.
    """
    frames = _take_frames(episode)
    lag_by_cav = [_find_least_lag(frames, column) for column in range(episode.egos)]
    lags = [lag for lag in lag_by_cav if lag is not None]
    return round(min(lags) * STRIDE * DT, 6) if lags else None


def _take_frames(episode: EpisodeRecord) -> _Frames:
    """Return the compared frames of the CAVs and of all that move."""
    valid = episode.valid[::STRIDE]
    moving = (np.abs(episode.speed[::STRIDE]) * valid).max(axis=0) > 0.0
    moving[: episode.egos] = True
    x, y, yaw = (values[::STRIDE][:, moving] for values in (episode.x, episode.y, episode.yaw))
    return _Frames(x, y, yaw, valid[:, moving], episode.length[moving], episode.width[moving])


def _find_least_lag(frames: _Frames, column: int) -> int | None:
    """Return the least number of frames between a CAV and a later column in the same place; None beyond the horizon."""
    frame, lag, other = _find_near(frames, column)
    second = frame + lag
    turn = portable.cos(frames.yaw[second, other] - frames.yaw[frame, column])
    across = turn <= portable.cos(MIN_TURN)
    frame, second, other, lag = frame[across], second[across], other[across], np.abs(lag[across])
    for least in np.unique(lag):
        now = lag == least
        own = _corners(frames, frame[now], np.full(np.count_nonzero(now), column))
        if boxes_overlap(own, _corners(frames, second[now], other[now])).any():
            return int(least)
    return None


def _find_near(frames: _Frames, column: int) -> tuple[Int, Int, Int]:
    """Return frame, lag and later column (n,) of all pairs of frames in which the circles around the boxes overlap."""
    radii = portable.hypot(frames.length, frames.width) / 2
    others = column + 1 + np.flatnonzero(_share_ground(frames, column, radii))
    gap_x, gap_y = (
        _shift(values[:, others], frames.valid[:, others]) - values[:, column, None, None]
        for values in (frames.x, frames.y)
    )
    reach = (radii[others] + radii[column])[:, None]
    near = portable.square(gap_x) + portable.square(gap_y) < portable.square(reach)
    frame, other, window = np.nonzero(near & frames.valid[:, column, None, None])
    return frame, window - LAGS, others[other]


def _share_ground(frames: _Frames, column: int, radii: Float) -> Bool:
    """Return whether the axis-parallel rectangles around the paths of the CAV and of each later column overlap."""
    valid, share = frames.valid[:, column:], np.ones(len(radii) - column, dtype=np.bool_)
    for values in (frames.x[:, column:], frames.y[:, column:]):
        low = np.where(valid, values, np.inf).min(axis=0) - radii[column:]
        high = np.where(valid, values, -np.inf).max(axis=0) + radii[column:]
        share &= (low <= high[0]) & (low[0] <= high)
    return share[1:]


def _shift(values: Float, valid: Bool) -> Float:
    """Return values (S, K) of all frames at most `LAGS` before or after each frame, (S, K, 2 LAGS + 1); NaN if none."""
    padded = np.pad(np.where(valid, values, np.nan), ((LAGS, LAGS), (0, 0)), constant_values=np.nan)
    return np.lib.stride_tricks.sliding_window_view(padded, 2 * LAGS + 1, axis=0)


def _corners(frames: _Frames, frame: Int, column: Int) -> Float:
    cell = frame, column
    return boxes_corners(frames.x[cell], frames.y[cell], frames.yaw[cell], frames.length[column], frames.width[column])


MIN_PET = ScalarMetric("min_pet", "min PET [s]", lambda scored: compute_min_pet(scored.episode), 1)
