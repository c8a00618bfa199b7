"""Minimum time to collision of an episode (after protocol 14.2): informative, no part of any score."""

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners
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
    velocity = np.stack(portable.cos_sin(episode.yaw), axis=-1) * episode.speed[..., None]
    place = np.stack((episode.x, episode.y), axis=-1)
    least = [_compute_min_of_cav(episode, place, velocity, column) for column in range(episode.egos)]
    return min((value for value in least if value is not None), default=None)


def _compute_min_of_cav(episode: EpisodeRecord, place: Float, velocity: Float, column: int) -> float | None:
    """Return `compute_min_ttc` of the pairs of one CAV with later columns, so that every pair is checked once."""
    live = np.flatnonzero(episode.valid[:, column])
    rest = slice(column + 1, None)
    apart = place[live, rest] - place[live, column, None]
    drift = velocity[live, rest] - velocity[live, column, None]
    close = episode.valid[live, rest] & _may_touch(apart, drift, _compute_contact_distance(episode, column, rest))
    row, other = np.nonzero(close)
    if not len(row):
        return None
    tick, other_column = live[row], other + column + 1
    own = _corners(episode, tick, np.full_like(tick, column))
    times = _compute_contact_times(own, _corners(episode, tick, other_column), drift[row, other])
    within = times[times <= HORIZON_S]
    return float(within.min()) if len(within) else None


def _compute_contact_distance(episode: EpisodeRecord, column: int, rest: slice) -> Float:
    """Return the distance of centres (M,) [m] beyond which the boxes cannot touch."""
    radius = portable.hypot(episode.length, episode.width) / 2
    return radius[rest] + radius[column]


def _may_touch(apart: Float, drift: Float, reach: Float) -> Bool:
    """Return an (n, M) mask of pairs that approach at 1 m/s or more and may touch within the horizon."""
    distance = portable.hypot(apart[..., 0], apart[..., 1])
    closing = -(apart * drift).sum(-1)
    return (closing >= MIN_CLOSING_SPEED * distance) & (
        distance - reach <= HORIZON_S * portable.hypot(drift[..., 0], drift[..., 1])
    )


def _corners(episode: EpisodeRecord, tick: Int, column: Int) -> Float:
    return boxes_corners(
        episode.x[tick, column],
        episode.y[tick, column],
        episode.yaw[tick, column],
        episode.length[column],
        episode.width[column],
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
