"""Minimum time to collision of an episode (after protocol 14.2): informative, no part of any score."""

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, boxes_corners
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.scoring.metrics.metric import ScalarMetric

HORIZON_S = 1.8
"""Greatest time to collision [s] that is reported."""
MIN_CLOSING_SPEED = 1.0
"""[m/s]"""


def compute_min_ttc(episode: EpisodeRecord) -> float | None:
    """Return the minimum time to collision [s] over all ticks and all pairs with a CAV; None if never within 1.8 s.

    Both boxes keep the velocity of that tick, without turning; pairs whose centres approach at less than 1 m/s are
    left out. The original's contact geometry is unknown, and it samples every 0.15 s; this function uses oriented boxes
    and the exact time of contact. 0 means that boxes overlap.
    """
    columns = episode.x, episode.y, episode.yaw, episode.speed, episode.valid, episode.length, episode.width
    least = [_find_least_time(*columns, column) for column in range(episode.egos)]
    return min((value for value in least if value is not None), default=None)


@twin
def _find_least_time(
    x: Float, y: Float, yaw: Float, speed: Float, valid: Bool, length: Float, width: Float, column: int, /
) -> float | None:
    """Return `compute_min_ttc` of the pairs of one CAV with later columns, so that every pair is checked once."""
    live = np.flatnonzero(valid[:, column])
    rest = slice(column + 1, None)
    velocity = np.stack(portable.cos_sin(yaw), axis=-1) * speed[..., None]
    place, radius = np.stack((x, y), axis=-1), portable.hypot(length, width) / 2
    apart = place[live, rest] - place[live, column, None]
    drift = velocity[live, rest] - velocity[live, column, None]
    row, other = np.nonzero(valid[live, rest] & _may_touch(apart, drift, radius[rest] + radius[column]))
    tick, column_of_other = live[row], other + column + 1
    own, theirs = (
        boxes_corners(x[tick, of], y[tick, of], yaw[tick, of], length[of], width[of])
        for of in (np.full_like(tick, column), column_of_other)
    )
    times = _compute_contact_times(own, theirs, drift[row, other])
    least = times.min(initial=np.inf) + 0.0  # no -0.0
    return float(least) if least <= HORIZON_S else None


def _may_touch(apart: Float, drift: Float, reach: Float) -> Bool:
    """Return an (n, M) mask of pairs that approach at 1 m/s or more and may touch within the horizon."""
    distance = portable.hypot(apart[..., 0], apart[..., 1])
    closing = -portable.dot(apart, drift)
    return (closing >= MIN_CLOSING_SPEED * distance) & (
        distance - reach <= HORIZON_S * portable.hypot(drift[..., 0], drift[..., 1])
    )


def _compute_contact_times(own: Float, other: Float, drift: Float) -> Float:
    """Return when boxes (K, 4, 2) touch [s], `other` moving at `drift` (K, 2) [m/s]; inf if never, 0 if they overlap.

    Swept separating axes: on each axis of both boxes the projections overlap in a time interval; the boxes touch when
    the last of the four intervals begins, unless another one has ended before.
    """
    enter = np.zeros(len(own))
    leave = np.full(len(own), np.inf)
    for corners in (own, other):
        for end in (1, 3):
            axis = corners[:, end] - corners[:, 0]
            a, b = (portable.dot(box, axis[:, None]) for box in (own, other))
            speed = portable.dot(drift, axis)
            first, last = _compute_overlap_times(a.min(1) - b.max(1), a.max(1) - b.min(1), speed)
            enter, leave = np.maximum(enter, first), np.minimum(leave, last)
    return np.where(enter <= leave, enter, np.inf)


def _compute_overlap_times(low: Float, high: Float, speed: Float) -> tuple[Float, Float]:
    """Return the times (K,) between which low <= speed * time <= high; an empty interval if there are none."""
    moving = np.abs(speed) > 1e-9
    rate = np.where(moving, speed, 1.0)
    first, last = np.minimum(low / rate, high / rate), np.maximum(low / rate, high / rate)
    always = (low <= 0.0) & (high >= 0.0)
    return (
        np.where(moving, first, np.where(always, -np.inf, np.inf)),
        np.where(moving, last, np.where(always, np.inf, -np.inf)),
    )


MIN_TTC = ScalarMetric("min_ttc", "min TTC [s]", lambda scored: compute_min_ttc(scored.episode))
