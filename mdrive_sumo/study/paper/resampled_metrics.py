"""Open-loop metrics of many resamples of recordings at once: the same numbers as `combine_metrics`."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.open_loop import OpenLoopScenario

CHUNK = 500
"""Resamples whose precision curves are in memory at once."""


def resample_metric(recordings: Sequence[OpenLoopScenario], metric: str, counts: Float) -> Float:
    """Return an open-loop metric (R,) where recording j counts `counts[r, j]` times; NaN where it is undefined.

    As in `combine_metrics`, each frame has the same weight; for the collision rate `cr` each recording.
    """
    if metric == "ap50":
        chunks = [counts[place : place + CHUNK] for place in range(0, len(counts), CHUNK)]
        return np.concatenate([100.0 * _compute_precision(recordings, chunk) for chunk in chunks])
    values = [getattr(one, metric) for one in recordings]
    frames = [1 if metric == "cr" else one.frames for one in recordings]
    weights = np.array([0 if value is None else count for value, count in zip(values, frames, strict=True)])
    known = np.array([0.0 if value is None else value for value in values])
    return _divide(counts @ (weights * known), counts @ weights)


def _compute_precision(recordings: Sequence[OpenLoopScenario], counts: Float) -> Float:
    """Return average precision in [0, 1] (R,): area under the interpolated curve of precision over recall."""
    tables = [one.count_detections() for one in recordings]
    scores = sorted({score for table in tables for score in table.by_score}, reverse=True)
    cells = np.array([[table.by_score.get(score, (0, 0)) for score in scores] for table in tables], dtype=float)
    if not scores:
        return np.full(len(counts), np.nan)
    found, accepted = (np.cumsum(counts @ cells[:, :, part], axis=1) for part in (0, 1))
    truths = counts @ np.array([table.truths for table in tables], dtype=float)
    recall = _divide(np.pad(found, ((0, 0), (1, 0))), np.broadcast_to(truths[:, None], (len(counts), len(scores) + 1)))
    precision = np.nan_to_num(_divide(found, accepted))
    best_after = np.maximum.accumulate(precision[:, ::-1], axis=1)[:, ::-1]
    return (np.diff(recall, axis=1) * best_after).sum(axis=1)


def _divide(numerator: Float, denominator: Float) -> Float:
    """Return the quotient; NaN where the denominator is 0."""
    return np.divide(numerator, denominator, out=np.full(numerator.shape, np.nan), where=denominator > 0)
