"""Average precision of detections in the plane (protocol 13.3).

Detections of a frame are matched greedily, the most certain first, with the ground-truth box of the greatest overlap
that is still free; the precision is interpolated at all points (VOC 2010).
"""

from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from mdrive_sumo.contract import Detections
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.perception.box_iou import compute_ious

MIN_IOU = 0.5
"""Intersection over union at which a detection counts (paper)."""
SCORE_STEPS = 1000
"""Scores are compared in thousandths."""
Array = npt.NDArray[np.generic]


@dataclass
class DetectionCounts:
    """Detections and ground-truth boxes of any number of frames; counts of frames or recordings can be added up."""

    truths: int = 0
    """Number of ground-truth boxes."""
    by_score: dict[int, tuple[int, int]] = field(default_factory=lambda: {})
    """Score in thousandths -> number of detections with a ground-truth box of their own, and number of detections."""

    @property
    def detections(self) -> int:
        """Number of detections."""
        return sum(count for _, count in self.by_score.values())

    def add(self, other: "DetectionCounts") -> None:
        """Add the counts of other frames."""
        self.truths += other.truths
        for score, (true, count) in other.by_score.items():
            before = self.by_score.get(score, (0, 0))
            self.by_score[score] = before[0] + true, before[1] + count


def match_frame(detections: Detections, truth: Float) -> DetectionCounts:
    """Return the counts of one frame; truth: ground-truth boxes (M, 5), as `Detections.boxes`."""
    order = np.argsort(-detections.scores, kind="stable")
    matches = match_boxes(compute_ious(detections.boxes[order], truth), MIN_IOU)
    counts = DetectionCounts(len(truth))
    for match, score in zip(matches.tolist(), detections.scores[order].tolist(), strict=True):
        key = round(SCORE_STEPS * score)
        true, count = counts.by_score.get(key, (0, 0))
        counts.by_score[key] = true + (match >= 0), count + 1
    return counts


def match_boxes(overlap: Float, min_iou: float) -> Int:
    """Return the row of the ground-truth box of each detection (N,), -1: none; the most certain ones come first.

    overlap: (N, M) intersection over union. A box is found once: by the first detection whose best free one it is.
    """
    free = overlap.copy()
    matches = np.full(len(free), -1, dtype=np.int64)
    for row in range(len(free) if free.shape[1] else 0):
        best = int(free[row].argmax())
        if free[row, best] >= min_iou:
            free[:, best] = -1.0
            matches[row] = best
    return matches


def compute_average_precision(counts: DetectionCounts) -> float | None:
    """Return the area in [0, 1] under the interpolated curve of precision over recall; None without ground truth.

    Detections with the same score, in thousandths, are accepted together.
    """
    if not counts.truths:
        return None
    steps = np.array([counts.by_score[score] for score in sorted(counts.by_score, reverse=True)]).reshape(-1, 2)
    return float(integrate_precision(steps[:, 0], steps[:, 1], np.array(counts.truths)))


def integrate_precision(true: Array, found: Array, truths: Array) -> Float:
    """Return the areas (...) under interpolated curves of precision over recall; 0 without ground truth.

    true, found: (..., K) true detections and all detections of each score, the highest score first. truths: (...).
    """
    all_true, all_found = np.cumsum(true, axis=-1), np.cumsum(found, axis=-1)
    recall = all_true / np.maximum(truths, 1)[..., None]
    precision = all_true / np.maximum(all_found, 1)
    best_after = np.maximum.accumulate(precision[..., ::-1], axis=-1)[..., ::-1]
    return np.asarray((np.diff(recall, axis=-1, prepend=0.0) * best_after).sum(axis=-1))
