"""Boxes from the maps of a detection head, and from the boxes of other cars (late fusion)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.fusion_spec import GRID_REACH_M, OUTPUT_CELL_M
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Int, wrap_angles
from mdrive_sumo.perception.box_iou import suppress_overlaps

MIN_SCORE = 0.1
"""What is less certain is no box. A fresh head answers 0.1 everywhere; such boxes come last in AP, and cost time."""
MAX_PEAKS = 200
"""The most certain ones are decoded; the densest scenes have 84 vehicles."""
MAX_IOU = 0.15
"""Of two boxes of one class: bodies do not overlap, so what does is found twice."""
LOG_SIDES = -2.3, 3.4
"""Logarithms of sides [m] of boxes: 0.1 is less than a person's, 30 more than an articulated bus's. A network that is
fed noise answers any number."""
HALF_TURN_FROM_RAD = np.pi / 4
"""See `BOX_NUMBERS`: headings straight ahead, across and oncoming are all 45 degrees or more from where the number that
tells both ends apart changes its sign."""


@dataclass(frozen=True, slots=True)
class DetectedBoxes:
    """Boxes of one frame in the ego frame, the most certain first."""

    boxes: Float
    """(N, 5): x, y [m], yaw [rad], length, width [m]."""
    classes: Int
    """(N,) index into `fusion_spec.CLASSES`."""
    scores: Float
    """(N,) in [0, 1]."""


def decode_boxes(
    scores: npt.NDArray[np.float32], numbers: npt.NDArray[np.float32], min_score: float = MIN_SCORE
) -> DetectedBoxes:
    """Return the boxes at the peaks of score maps.

    scores: (classes, OUTPUT_CELLS, OUTPUT_CELLS). numbers: (BOX_NUMBERS, OUTPUT_CELLS, OUTPUT_CELLS). A peak is no less
    than its eight neighbours. Cells with numbers that are not finite hold no box.
    """
    kind, row, column = np.nonzero((scores >= min_score) & np.isfinite(numbers).all(axis=0))
    score = scores[kind, row, column].astype(np.float64)
    padded = np.pad(scores, ((0, 0), (1, 1), (1, 1)))
    around = [padded[kind, row + i, column + j] for i in range(3) for j in range(3)]
    peaks = np.flatnonzero(score >= np.max(around, axis=0))
    peaks = peaks[np.argsort(-score[peaks], kind="stable")[:MAX_PEAKS]]
    kind, row, column, score = kind[peaks], row[peaks], column[peaks], score[peaks]
    boxes = _decode_numbers(numbers[:, row, column].astype(np.float64), row, column)
    kept = suppress_overlaps(boxes, score, kind, MAX_IOU)
    return DetectedBoxes(boxes[kept], kind[kept], score[kept])


def _decode_numbers(numbers: Float, row: Int, column: Int) -> Float:
    """Return boxes (N, 5) of numbers (BOX_NUMBERS, N) at cells."""
    dx, dy, log_length, log_width, cos2, sin2, ahead = numbers
    log_length, log_width = (np.clip(side, *LOG_SIDES) for side in (log_length, log_width))
    x = GRID_REACH_M - (row + 0.5) * OUTPUT_CELL_M + dx
    y = GRID_REACH_M - (column + 0.5) * OUTPUT_CELL_M + dy
    axis = portable.atan2(sin2, cos2) / 2
    is_ahead = np.abs(wrap_angles(axis - HALF_TURN_FROM_RAD)) < np.pi / 2
    yaw = wrap_angles(np.where(is_ahead == (ahead > 0), axis, axis + np.pi))
    return np.stack((x, y, yaw, portable.exp(log_length), portable.exp(log_width)), axis=-1)


def merge_boxes(found: Sequence[DetectedBoxes], poses: npt.NDArray[np.floating]) -> DetectedBoxes:
    """Return the boxes of several cars as one list in the frame of the first: late fusion.

    poses: (N, 3) x, y [m], yaw [rad] of each car in that frame. Boxes whose centre lies outside of the grid are
    dropped; of boxes that overlap the most certain one stays.
    """
    moved = [_move_boxes(one.boxes, pose) for one, pose in zip(found, poses, strict=True)]
    boxes = np.concatenate(moved)
    inside = np.flatnonzero((np.abs(boxes[:, :2]) <= GRID_REACH_M).all(axis=1))
    boxes = boxes[inside]
    scores = np.concatenate([one.scores for one in found])[inside]
    classes = np.concatenate([one.classes for one in found])[inside]
    kept = suppress_overlaps(boxes, scores, classes, MAX_IOU)
    return DetectedBoxes(boxes[kept], classes[kept], scores[kept])


def _move_boxes(boxes: Float, pose: npt.NDArray[np.floating]) -> Float:
    """Return boxes (N, 5) of the frame of a pose (3,) in the frame in which the pose is given."""
    x, y, yaw = (float(value) for value in pose)
    cos, sin = portable.cos_sin(yaw)
    moved = boxes.copy()
    moved[:, 0] = x + cos * boxes[:, 0] - sin * boxes[:, 1]
    moved[:, 1] = y + sin * boxes[:, 0] + cos * boxes[:, 1]
    moved[:, 2] = wrap_angles(boxes[:, 2] + yaw)
    return moved
