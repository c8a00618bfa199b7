"""Minimum post-encroachment time of an episode: informative, no part of any score."""

import math
from typing import NamedTuple

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
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
    lag_by_cav = [_find_least_lag(*frames, column) for column in range(episode.egos)]
    lags = [lag for lag in lag_by_cav if lag is not None]
    return round(min(lags) * STRIDE * DT, 6) if lags else None


def _take_frames(episode: EpisodeRecord) -> _Frames:
    """Return the compared frames of the CAVs and of all that move."""
    valid = episode.valid[::STRIDE]
    moving = (np.abs(episode.speed[::STRIDE]) * valid).max(axis=0) > 0.0
    moving[: episode.egos] = True
    x, y, yaw = (values[::STRIDE][:, moving] for values in (episode.x, episode.y, episode.yaw))
    return _Frames(x, y, yaw, valid[:, moving], episode.length[moving], episode.width[moving])


@twin
def _find_least_lag(
    x: Float, y: Float, yaw: Float, valid: Bool, length: Float, width: Float, column: int, /
) -> int | None:
    """Return the least number of frames between a CAV and a later column in the same place; None beyond the horizon.

    The columns are those of `_Frames`.
    """
    frames = _Frames(x, y, yaw, valid, length, width)
    lags = (lag for lag in range(LAGS + 1) if _do_meet(frames, column, lag) or _do_meet(frames, column, -lag))
    return next(lags, None)


def _do_meet(frames: _Frames, column: int, lag: int) -> bool:
    """Return whether a later column comes, `lag` frames after the CAV, to a place of the CAV across its direction."""
    first = np.arange(max(0, -lag), len(frames.x) - max(0, lag))[:, None]
    second, others = first + lag, np.arange(column + 1, len(frames.length))
    radii = portable.hypot(frames.length, frames.width) / 2
    gap_x, gap_y = (values[second, others] - values[first, column] for values in (frames.x, frames.y))
    near = portable.square(gap_x) + portable.square(gap_y) < portable.square(radii[others] + radii[column])
    frame, other = np.nonzero(near & frames.valid[first, column] & frames.valid[second, others])
    first, second, other = first[frame, 0], second[frame, 0], others[other]
    across = portable.cos(frames.yaw[second, other] - frames.yaw[first, column]) <= portable.cos(MIN_TURN)
    own = _corners(frames, first[across], np.full(np.count_nonzero(across), column))
    return bool(boxes_overlap(own, _corners(frames, second[across], other[across])).any())


def _corners(frames: _Frames, frame: Int, column: Int) -> Float:
    cell = frame, column
    return boxes_corners(frames.x[cell], frames.y[cell], frames.yaw[cell], frames.length[column], frames.width[column])


MIN_PET = ScalarMetric("min_pet", "min PET [s]", lambda scored: compute_min_pet(scored.episode), 1)
