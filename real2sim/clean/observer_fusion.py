"""Fuse observers: group segments that show the same object at the same time, and average them."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import Kind
from real2sim.clean.track_segments import FusedTrack, TrackSegments

MIN_COMMON_FRAMES = 3
"""Number of frames that two segments must share (or all of the shorter one)."""
SAME_ID_M = 1.5
"""[m] Two observers of one object differ by up to 0.9 m in its centre."""
LENGTH_SHARE, WIDTH_SHARE = 0.35, 0.45
"""Shares of length and width within which centres with different ids may be one vehicle."""
PEDESTRIAN_M, PEDESTRIAN_CROSS_VIEW_M = 0.4, 0.55
"""[m] Pedestrians walk 0.6 m apart. Two observers may differ more about one pedestrian than one observer does."""
P90_FACTOR = 1.8
"""Factor by which the 90th percentile of the distance may exceed the limit of the median."""
TURNED_RAD = float(np.radians(35.0))
"""Chosen: boxes that differ by more in direction, modulo pi, are those of two vehicles."""
CROSS_VIEW_LIMIT = 1.5
"""Segments of two observers further apart than this multiple of the limit are never one object."""
BRIDGED_FRAMES = 20
"""Gaps of one observer up to this length are bridged if the ids agree."""
RAMP_FRAMES = 10
"""The weight of an observer rises and falls over this many frames, so that the weighted mean does not jump."""
OUTLIER_M = 0.3
"""[m] Scale of the Cauchy weights: a position this far from the mean has half the weight."""
UNKNOWN_LENGTH_M, UNKNOWN_WIDTH_M = 4.0, 1.8
"""[m] Dimensions assumed where the source gives none, for every label because labels flip."""


def group_segments(segments: TrackSegments) -> list[list[int]]:
    """Group segments that show the same object while they overlap in time, nearest pairs first."""
    bridged = _bridge_short_gaps(segments)
    first, second = _find_candidate_pairs(bridged)
    closeness = _compute_dissimilarity(segments, first, second)
    named = np.flatnonzero([segments.ids[i] == segments.ids[j] for i, j in zip(first, second, strict=True)])
    if len(named):
        closeness[named] = _compute_dissimilarity(bridged, first[named], second[named])
    common = segments.valid.astype(np.float32) @ segments.valid.T.astype(np.float32) > 0
    apart = common.copy()
    one_observer = segments.observer[first] == segments.observer[second]
    apart[first, second] = apart[second, first] = closeness > np.where(one_observer, 1.0, CROSS_VIEW_LIMIT)
    group = {i: [i] for i in range(len(segments))}
    owner = list(range(len(segments)))
    for n in np.argsort(closeness, kind="stable"):
        a, b = owner[first[n]], owner[second[n]]
        if closeness[n] > 1.0:
            break
        if a != b and not apart[np.ix_(group[a], group[b])].any():
            group[a] += group.pop(b)
            for i in group[a]:
                owner[i] = a
    return [sorted(members) for members in group.values()]


def _bridge_short_gaps(segments: TrackSegments) -> TrackSegments:
    """Return the segments with short gaps filled: two observers may see one id alternately only."""
    valid, x, y = segments.valid.copy(), segments.x.copy(), segments.y.copy()
    for k in range(len(segments)):
        frames = np.flatnonzero(segments.valid[k])
        for a, b in pairwise(frames.tolist()):
            if 1 < b - a <= BRIDGED_FRAMES:
                inner = np.arange(a + 1, b)
                valid[k, inner] = True
                x[k, inner], y[k, inner] = (np.interp(inner, (a, b), v[k, [a, b]]) for v in (segments.x, segments.y))
    return replace(segments, valid=valid, x=x, y=y)


def _find_candidate_pairs(segments: TrackSegments) -> tuple[Int, Int]:
    """Return index pairs of segments that share frames and whose enlarged bounding rectangles touch."""
    there = np.asarray(segments.valid.any(axis=1))
    low = np.array([_compute_minimum(values, segments.valid) for values in (segments.x, segments.y)]) - SAME_ID_M
    high = -np.array([_compute_minimum(-values, segments.valid) for values in (segments.x, segments.y)]) + SAME_ID_M
    touch = (low[:, :, None] <= high[:, None, :]).all(0)
    common = segments.valid.astype(np.float32) @ segments.valid.T.astype(np.float32) > 0
    first, second = np.nonzero(np.triu(touch & touch.T & common & there[:, None], 1))
    return first, second


def _compute_minimum(values: Float, valid: Bool) -> Float:
    return np.where(valid, values, np.inf).min(axis=1, initial=np.inf)


def _compute_dissimilarity(segments: TrackSegments, first: Int, second: Int) -> Float:
    """Return (N,) distances of pairs relative to the limit for one object: at most 1 means the same object."""
    common = segments.valid[first] & segments.valid[second]
    dx, dy = segments.x[second] - segments.x[first], segments.y[second] - segments.y[first]
    distance = np.hypot(dx, dy)
    middle, ninth = _compute_quantile(distance, common, 0.5), _compute_quantile(distance, common, 0.9)
    walker = np.array([category.kind is Kind.PEDESTRIAN for category in segments.categories], dtype=np.bool_)
    named = np.array([segments.ids[i] == segments.ids[j] for i, j in zip(first, second, strict=True)], dtype=np.bool_)
    walkers, mixed = walker[first] & walker[second], walker[first] ^ walker[second]
    by_name = np.maximum(middle / SAME_ID_M, ninth / (P90_FACTOR * SAME_ID_M))
    reach = np.where(segments.observer[first] == segments.observer[second], PEDESTRIAN_M, PEDESTRIAN_CROSS_VIEW_M)
    by_place = np.maximum(middle / reach, ninth / (P90_FACTOR * reach))
    closeness = np.where(walkers, by_place, _compute_box_dissimilarity(segments, first, second, (dx, dy)))
    closeness = np.where(mixed, np.inf, closeness)
    closeness = np.where(named, by_name, closeness)
    count = common.sum(1)
    least = np.where(named, 1, MIN_COMMON_FRAMES)
    least = np.minimum(least, np.minimum(segments.valid[first].sum(1), segments.valid[second].sum(1)))
    return np.where(count >= least, closeness, 1.0 + 1e-9 + closeness)


def _compute_box_dissimilarity(segments: TrackSegments, first: Int, second: Int, gap: tuple[Float, Float]) -> Float:
    """Return the dissimilarity (N,) of vehicle pairs from offsets along and across the box and from the angle."""
    common = segments.valid[first] & segments.valid[second]
    yaw = np.where(np.isfinite(segments.yaw[first]), segments.yaw[first], np.arctan2(gap[1], gap[0]))
    along = np.abs(gap[0] * np.cos(yaw) + gap[1] * np.sin(yaw))
    across = np.abs(gap[1] * np.cos(yaw) - gap[0] * np.sin(yaw))
    length = (
        _compute_median_size(segments.length, UNKNOWN_LENGTH_M)[first]
        + _compute_median_size(segments.length, UNKNOWN_LENGTH_M)[second]
    ) / 2
    width = (
        _compute_median_size(segments.width, UNKNOWN_WIDTH_M)[first]
        + _compute_median_size(segments.width, UNKNOWN_WIDTH_M)[second]
    ) / 2
    turned = np.abs(np.sin(np.nan_to_num(segments.yaw[first] - segments.yaw[second])))
    return np.maximum.reduce(
        (
            _compute_quantile(along, common, 0.5) / (LENGTH_SHARE * length),
            _compute_quantile(across, common, 0.5) / (WIDTH_SHARE * width),
            _compute_quantile(along, common, 0.9) / (P90_FACTOR * LENGTH_SHARE * length),
            _compute_quantile(across, common, 0.9) / (P90_FACTOR * WIDTH_SHARE * width),
            _compute_quantile(turned, common, 0.5) / np.sin(TURNED_RAD),
        )
    )


def _compute_median_size(values: Float, unknown: float) -> Float:
    """Return the median (K,) of sizes (K, T)."""
    return np.nan_to_num(_compute_quantile(values, np.isfinite(values), 0.5), nan=unknown)


def _compute_quantile(values: Float, there: Bool, share: float) -> Float:
    """Return a quantile (N,) of the valid values (N, T), rounded down to a sample; NaN without any."""
    ordered = np.sort(np.where(there, values, np.inf), axis=1)
    count = there.sum(axis=1)
    picked = ordered[np.arange(len(values)), np.maximum((share * (count - 1)).astype(np.int64), 0)]
    return np.where(count > 0, picked, np.nan)


def fuse_segments(segments: TrackSegments, members: Sequence[int]) -> FusedTrack:
    """Return the weighted mean of the members in every frame; outliers are down-weighted (Cauchy weights).

    Computed once for each group: most of them stay as they are from step to step of the cleaning.
    """
    group = tuple(members)
    if group not in segments.fused:
        segments.fused[group] = _fuse_rows(segments, np.asarray(group))
    return segments.fused[group]


def _fuse_rows(segments: TrackSegments, rows: Int) -> FusedTrack:
    valid = segments.valid[rows]
    say = compute_ramp_weights(valid)
    x, y = segments.x[rows], segments.y[rows]
    there = np.asarray(valid.any(axis=0))
    centre = (_compute_weighted_mean(x, say), _compute_weighted_mean(y, say))
    for _ in range(3 if len(rows) > 2 else 0):
        off = np.nan_to_num(np.hypot(x - centre[0], y - centre[1]))
        weight = say / (1 + (off / OUTLIER_M) ** 2)
        centre = (_compute_weighted_mean(x, weight), _compute_weighted_mean(y, weight))
    yaw = segments.yaw[rows]
    yaw_weight = say * np.isfinite(yaw)
    sin, cos = (_compute_weighted_mean(of(2 * yaw), yaw_weight) for of in (np.sin, np.cos))
    return FusedTrack(there, centre[0], centre[1], np.arctan2(sin, cos) / 2)


def _compute_weighted_mean(values: Float, weight: Float) -> Float:
    total = weight.sum(axis=0)
    known = np.where(np.isfinite(values), values, 0.0)
    return np.where(total > 0, (known * weight).sum(axis=0) / np.where(total > 0, total, 1.0), np.nan)


def compute_ramp_weights(valid: Bool) -> Float:
    """Return weights (M, T): 1 inside a valid stretch, falling towards its ends, 0 where not valid.

    The first and the last frame of the log are not treated as ends, because no object disappears there.
    """
    members, frames = valid.shape
    frame_numbers = np.arange(frames)
    inside = np.full((members, frames), RAMP_FRAMES, dtype=np.int64)
    for absent, side in ((~valid, 1), (~valid[:, ::-1], -1)):
        last = np.maximum.accumulate(np.where(absent, frame_numbers, -RAMP_FRAMES - 1), axis=1)
        inside = np.minimum(inside, (frame_numbers - last)[:, ::side])
    return np.where(valid, np.clip(inside / RAMP_FRAMES, 0.0, 1.0) ** 2, 0.0)
