"""Average precision of detections in the plane (protocol 13.3).

Detections of a frame are matched greedily, the most certain first, with the ground-truth box of the greatest overlap
that is still free; the precision is interpolated at all points (VOC 2010).
"""

from dataclasses import dataclass, field

import numpy as np
import shapely

from mdrive_sumo.contract import Detections
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, boxes_corners

MIN_IOU = 0.5
"""Intersection over union at which a detection counts (paper)."""


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
    overlap = compute_overlaps(detections.boxes[order], truth)
    counts = DetectionCounts(len(truth))
    for row, score in enumerate(detections.scores[order].tolist()):
        best = int(overlap[row].argmax()) if len(truth) else -1
        is_true = best >= 0 and bool(overlap[row, best] >= MIN_IOU)
        if is_true:
            overlap[:, best] = -1.0  # found once
        key = round(1000 * score)
        true, count = counts.by_score.get(key, (0, 0))
        counts.by_score[key] = true + is_true, count + 1
    return counts


def compute_overlaps(first: Float, second: Float) -> Float:
    """Return the intersection over union (N, M) of oriented boxes (N, 5) and (M, 5)."""
    reach = [portable.hypot(boxes[:, 3], boxes[:, 4]) / 2 for boxes in (first, second)]
    apart = first[:, None, :2] - second[None, :, :2]
    rows, columns = np.nonzero(portable.hypot(apart[..., 0], apart[..., 1]) < reach[0][:, None] + reach[1])
    own, other = (shapely.polygons(boxes_corners(*boxes.T)) for boxes in (first[rows], second[columns]))
    common = np.zeros((len(first), len(second)))
    common[rows, columns] = shapely.area(shapely.intersection(own, other))
    areas = [boxes[:, 3] * boxes[:, 4] for boxes in (first, second)]
    return common / (areas[0][:, None] + areas[1] - common)


def compute_average_precision(counts: DetectionCounts) -> float | None:
    """Return the area in [0, 1] under the interpolated curve of precision over recall; None without ground truth.

    Detections with the same score, in thousandths, are accepted together.
    """
    if not counts.truths:
        return None
    steps = [counts.by_score[score] for score in sorted(counts.by_score, reverse=True)]
    true, accepted = (np.cumsum([step[i] for step in steps]) for i in (0, 1))
    recall = np.concatenate(((0.0,), true / counts.truths))
    best_after = np.maximum.accumulate((true / accepted)[::-1])[::-1]
    return float((np.diff(recall) * best_after).sum())
