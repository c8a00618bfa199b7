"""Where and when the own car would meet predicted motions: the boxes of all motions are tested in one call."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import VehicleFacts
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap
from mdrive_sumo.planning.motion_prediction import STRIDE, TIMES, PredictedMotion
from mdrive_sumo.planning.parameters import SafetyMargin
from mdrive_sumo.planning.path_overlap import compute_footprints, find_overlapping_pairs
from mdrive_sumo.planning.reference_path import ReferencePath


@dataclass(frozen=True, slots=True)
class PredictedBoxes:
    """The boxes (B,) of all motions. A box that stays where it is (a standing object) is one for all its times."""

    corners: Float
    """(B, 4, 2) [m]"""
    begin: Int
    """First row of `TIMES` at which a box is there."""
    end: Int
    """Row after the last one; beyond all rows for a box that stays for ever."""
    min_gap_m: Float
    """See `PredictedMotion`."""
    motion: Int
    """Number of the motion."""


class MotionConflicts:
    """The own path and what would meet the own car on it."""

    def __init__(self, path: ReferencePath, vehicle: VehicleFacts, motions: Sequence[PredictedMotion]) -> None:
        self._path, self._vehicle, self._motions = path, vehicle, motions
        self._boxes = list_predicted_boxes(motions)

    def find_blocked(self, cells: Int, margin: SafetyMargin, stride: int = 1) -> Bool:
        """Return a mask (T * STRIDE, J): whether the own box in cell j overlaps a predicted box.

        Rows are samples of a profile, `STRIDE` for each of `TIMES`; only every `stride`-th cell is compared, the next
        ones are blocked as that one is.
        """
        return find_blocked(self._path, self._vehicle, self._boxes, cells, margin, stride)

    def find_blocked_after(self, cells: Int, margin: SafetyMargin) -> Bool:
        """Return a mask (J,): whether the own box in cell j overlaps a box of a motion that stands at the end."""
        return find_blocked_after(self._path, self._vehicle, self._boxes, cells, margin)

    def find_met(self, cells: Int, margin: SafetyMargin) -> Bool:
        """Return a mask (K,): whether the own box in cell k (K,) overlaps a predicted box at the k-th time."""
        return find_met(self._path, self._vehicle, self._boxes, cells, margin)

    def find_first_met(self, cells: Int, margin: SafetyMargin) -> tuple[int, PredictedMotion] | None:
        """Return the first k at which the own box in cell k (K,) overlaps a predicted box at the k-th time, and whose.

        None if it meets nothing.
        """
        met = find_first_met(self._path, self._vehicle, self._boxes, cells, margin)
        return None if met is None else (met[0], self._motions[met[1]])


@twin
def list_predicted_boxes(motions: Sequence[PredictedMotion], /) -> PredictedBoxes:
    """Return the boxes of all motions."""
    parts = [_describe_boxes(number, motion) for number, motion in enumerate(motions)]
    columns = np.concatenate(parts) if parts else np.zeros((0, 9))
    x, y, yaw, length, width, min_gap_m = columns[:, :6].T
    begin, end, motion = columns[:, 6:].T.astype(np.int64)
    return PredictedBoxes(boxes_corners(x, y, yaw, length, width), begin, end, min_gap_m, motion)


def _describe_boxes(number: int, motion: PredictedMotion) -> Float:
    """Return the boxes (B, 9) of a motion: x, y, yaw, length, width, minimum gap, first row, row after it, motion."""
    poses = motion.poses
    count = len(poses)
    columns = np.empty((count, 9))
    columns[:, :3], columns[:, 3], columns[:, 4], columns[:, 5] = poses, motion.length, motion.width, motion.min_gap_m
    moves = np.ones(count, dtype=np.bool_)
    np.any(columns[1:, :4] != columns[:-1, :4], axis=1, out=moves[1:])
    first = np.flatnonzero(moves)
    boxes = columns[first]
    boxes[:, 6] = first
    boxes[:-1, 7] = first[1:]
    boxes[-1:, 7] = len(TIMES) + 1 if motion.stands_at_end else count
    boxes[:, 8] = number
    return boxes


@twin
def find_blocked(
    path: ReferencePath,
    vehicle: VehicleFacts,
    boxes: PredictedBoxes,
    cells: Int,
    margin: SafetyMargin,
    stride: int,
    /,
) -> Bool:
    """Return `MotionConflicts.find_blocked`."""
    compared = cells[::stride]
    blocked = np.zeros((len(TIMES), len(compared)), dtype=np.bool_)
    for row, own in zip(*_find_pairs(path, vehicle, boxes, compared, margin), strict=True):
        blocked[boxes.begin[row] : boxes.end[row], own] = True
    return np.repeat(np.repeat(blocked, STRIDE, axis=0), stride, axis=1)[:, : len(cells)]


@twin
def find_blocked_after(
    path: ReferencePath, vehicle: VehicleFacts, boxes: PredictedBoxes, cells: Int, margin: SafetyMargin, /
) -> Bool:
    """Return `MotionConflicts.find_blocked_after`."""
    blocked = np.zeros(len(cells), dtype=np.bool_)
    rows, own = _find_pairs(path, vehicle, boxes, cells, margin)
    blocked[own[boxes.end[rows] > len(TIMES)]] = True
    return blocked


def _find_pairs(
    path: ReferencePath, vehicle: VehicleFacts, boxes: PredictedBoxes, cells: Int, margin: SafetyMargin
) -> tuple[Int, Int]:
    """Return boxes (P,) and cells (P,) that conflict, as indices: within the margin, then within larger gaps."""
    length, width = vehicle.length + 2 * margin.longitudinal, vehicle.width + 2 * margin.lateral
    own, rows = find_overlapping_pairs(compute_footprints(path, length, width, cells), boxes.corners)
    for gap_m in np.unique(boxes.min_gap_m[boxes.min_gap_m > margin.longitudinal]).tolist():
        wide = np.flatnonzero(boxes.min_gap_m == gap_m)
        mine = compute_footprints(path, vehicle.length + 2 * gap_m, vehicle.width, cells)
        more, of_wide = find_overlapping_pairs(mine, boxes.corners[wide])
        own, rows = np.append(own, more), np.append(rows, wide[of_wide])
    return rows, own


@twin
def find_met(
    path: ReferencePath, vehicle: VehicleFacts, boxes: PredictedBoxes, cells: Int, margin: SafetyMargin, /
) -> Bool:
    """Return `MotionConflicts.find_met`."""
    met = np.zeros(len(cells), dtype=np.bool_)
    met[_find_meetings(path, vehicle, boxes, cells, margin)[0]] = True
    return met


@twin
def find_first_met(
    path: ReferencePath, vehicle: VehicleFacts, boxes: PredictedBoxes, cells: Int, margin: SafetyMargin, /
) -> tuple[int, int] | None:
    """Return the k of `MotionConflicts.find_first_met` and the number of the motion."""
    rows, met = _find_meetings(path, vehicle, boxes, cells, margin)
    if not len(rows):
        return None
    first = int(rows.argmin())
    return int(rows[first]), int(boxes.motion[met[first]])


def _find_meetings(
    path: ReferencePath, vehicle: VehicleFacts, boxes: PredictedBoxes, cells: Int, margin: SafetyMargin
) -> tuple[Int, Int]:
    """Return every k (P,) at which the own box in cell k overlaps a predicted box, and that box (P,)."""
    counts = np.maximum(np.minimum(boxes.end, len(cells)) - boxes.begin, 0)
    theirs = np.repeat(np.arange(len(counts)), counts)
    rows = np.arange(len(theirs)) - np.repeat(np.cumsum(counts) - counts - boxes.begin, counts)
    length, width = vehicle.length + 2 * margin.longitudinal, vehicle.width + 2 * margin.lateral
    mine = compute_footprints(path, length, width, cells)
    met = boxes_overlap(mine[rows], boxes.corners[theirs])
    return rows[met], theirs[met]
