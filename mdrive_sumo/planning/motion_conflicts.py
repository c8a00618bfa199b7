"""Where and when the own car would meet predicted motions: the boxes of all motions are tested in one call."""

from collections.abc import Sequence

import numpy as np

from mdrive_sumo.contract import VehicleFacts
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners
from mdrive_sumo.planning.box_set import BoxSet
from mdrive_sumo.planning.motion_prediction import TIMES, PredictedMotion
from mdrive_sumo.planning.parameters import SafetyMargin
from mdrive_sumo.planning.path_overlap import compute_footprints
from mdrive_sumo.planning.reference_path import ReferencePath


class MotionConflicts:
    """The predicted boxes of all motions, each with the rows of `TIMES` at which it is there.

    A box that stays where it is (a standing object) is one box for all these times.
    """

    def __init__(self, path: ReferencePath, vehicle: VehicleFacts, motions: Sequence[PredictedMotion]) -> None:
        self._path, self._vehicle, self._motions = path, vehicle, motions
        parts = [_describe_boxes(motion) for motion in motions]
        self._counts = [len(part) for part in parts]
        columns = np.concatenate(parts) if parts else np.zeros((0, 8))
        x, y, yaw, length, width, self._min_gap_m = columns[:, :6].T
        self._begin, self._end = columns[:, 6:].T.astype(np.int64)
        """Rows of `TIMES` from the first on, up to before the second."""
        self._boxes = BoxSet.build(boxes_corners(x, y, yaw, length, width))

    def find_blocked(self, cells: Int, margin: SafetyMargin) -> Bool:
        """Return a mask (T, J): whether the own box in cell j overlaps a predicted box at time t."""
        blocked = np.zeros((len(TIMES), len(cells)), dtype=np.bool_)
        for boxes, own in self._find_pairs(cells, margin, np.arange(len(self._boxes))):
            begin, end = self._begin[boxes], self._end[boxes]
            blocked[begin, own] = True
            lasting = np.flatnonzero(end - begin > 1)
            for box in np.unique(boxes[lasting]).tolist():
                blocked[self._begin[box] : self._end[box], own[boxes == box]] = True
        return blocked

    def find_blocked_after(self, cells: Int, margin: SafetyMargin) -> Bool:
        """Return a mask (J,): whether the own box in cell j overlaps a box of a motion that stands at the end."""
        blocked = np.zeros(len(cells), dtype=np.bool_)
        for _, own in self._find_pairs(cells, margin, np.flatnonzero(self._end > len(TIMES))):
            blocked[own] = True
        return blocked

    def _find_pairs(self, cells: Int, margin: SafetyMargin, rows: Int) -> list[tuple[Int, Int]]:
        """Return boxes of `rows` and cells that conflict, as indices: within the margin, then within larger gaps."""
        length, width = self._vehicle.length, self._vehicle.width
        pairs = [self._find_overlaps(cells, length + 2 * margin.longitudinal, width + 2 * margin.lateral, rows)]
        gaps = self._min_gap_m[rows]
        for gap in np.unique(gaps[gaps > margin.longitudinal]).tolist():
            pairs.append(self._find_overlaps(cells, length + 2 * gap, width, rows[gaps == gap]))
        return pairs

    def _find_overlaps(self, cells: Int, length: float, width: float, rows: Int) -> tuple[Int, Int]:
        if not len(rows):
            return rows, rows
        mine = BoxSet.build(compute_footprints(self._path, length, width, cells))
        own, theirs = mine.find_pairs(self._boxes if len(rows) == len(self._boxes) else self._boxes.take(rows))
        return rows[theirs], own

    def find_met(self, cells: Int, margin: SafetyMargin) -> Bool:
        """Return a mask (K,): whether the own box in cell k (K,) overlaps a predicted box at the k-th time."""
        met = np.zeros(len(cells), dtype=np.bool_)
        rows, _ = self._find_meetings(cells, margin)
        met[rows] = True
        return met

    def find_first_met(self, cells: Int, margin: SafetyMargin) -> tuple[int, PredictedMotion] | None:
        """Return the first k at which the own box in cell k (K,) overlaps a predicted box at the k-th time, and whose.

        None if it meets nothing.
        """
        rows, boxes = self._find_meetings(cells, margin)
        if not len(rows):
            return None
        first = int(rows.argmin())
        motion = int(np.searchsorted(np.cumsum(self._counts), boxes[first], side="right"))
        return int(rows[first]), self._motions[motion]

    def _find_meetings(self, cells: Int, margin: SafetyMargin) -> tuple[Int, Int]:
        """Return every k (P,) at which the own box in cell k overlaps a predicted box, and that box (P,)."""
        counts = np.maximum(np.minimum(self._end, len(cells)) - self._begin, 0)
        boxes = np.repeat(np.arange(len(counts)), counts)
        rows = np.arange(len(boxes)) - np.repeat(np.cumsum(counts) - counts - self._begin, counts)
        length, width = self._vehicle.length + 2 * margin.longitudinal, self._vehicle.width + 2 * margin.lateral
        mine = BoxSet.build(compute_footprints(self._path, length, width, cells))
        return mine.find_overlapping(rows, self._boxes, boxes)


def _describe_boxes(motion: PredictedMotion) -> Float:
    """Return the boxes (B, 8) of a motion: x, y, yaw, length, width, minimum gap, first row of time, row after it.

    The last box of a motion that stands at the end stays for ever: its row after it is beyond all times.
    """
    poses = motion.poses
    count = len(poses)
    columns = np.empty((count, 8))
    columns[:, :3], columns[:, 3], columns[:, 4], columns[:, 5] = poses, motion.length, motion.width, motion.min_gap_m
    moves = np.ones(count, dtype=np.bool_)
    np.any(columns[1:, :4] != columns[:-1, :4], axis=1, out=moves[1:])
    first = np.flatnonzero(moves)
    boxes = columns[first]
    boxes[:, 6] = first
    boxes[:-1, 7] = first[1:]
    boxes[-1:, 7] = len(TIMES) + 1 if motion.stands_at_end else count
    return boxes
