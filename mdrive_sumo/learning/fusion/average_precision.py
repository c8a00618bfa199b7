"""Average precision of detectors that share, by distance and by occlusion, with intervals over places.

Detections are sorted by score over the whole set, as VOC 2010 does, never frame by frame. All detectors are measured on
the same true boxes: those on which any car of the frame has a point.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from mdrive_sumo.agents.learned.box_decoding import DetectedBoxes
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.statistics import (
    Counts,
    Label,
    ResampledMean,
    count_effective,
    draw_nested_counts,
    sum_resamples,
)
from mdrive_sumo.learning.fusion.frames import FusionFrames
from mdrive_sumo.open_loop.detection_precision import SCORE_STEPS, integrate_precision, match_boxes
from mdrive_sumo.perception.box_iou import compute_ious

RESAMPLES_OF_AP = 2000
"""Of the 10 000 that means have: each sorts all detections anew."""


@dataclass(frozen=True, slots=True)
class BoxGroup:
    """True boxes and detections that are measured together. Others are left out, found or not."""

    is_of_truth: Callable[[Float, Int], Bool]
    """(distances (M,) [m] of true boxes, points (M,) of the own scan on them) -> (M,)."""
    is_of_detection: Callable[[Float], Bool]
    """Distances (N,) [m] of detections without a true box -> (N,): whether they are errors of this group."""


def _within(low_m: float, high_m: float) -> BoxGroup:
    return BoxGroup(lambda d, _: (d >= low_m) & (d < high_m), lambda d: (d >= low_m) & (d < high_m))


def _with_points(low: int, high: int) -> BoxGroup:
    # A false detection has no points of its own: it is an error in every group.
    return BoxGroup(lambda _, points: (points >= low) & (points <= high), lambda d: np.ones(len(d), dtype=np.bool_))


MANY = 2**31
"""More points than `box_points` (uint16) can hold: no upper bound."""
GROUPS: Mapping[str, BoxGroup] = MappingProxyType(
    {
        "all": _within(0.0, np.inf),
        "0-30 m": _within(0.0, 30.0),
        "30-50 m": _within(30.0, 50.0),
        "50-100 m": _within(50.0, 100.0),
        "0 points": _with_points(0, 0),
        "1-5 points": _with_points(1, 5),
        "more points": _with_points(6, MANY),
    }
)
"""Columns of the tables: distances from the own car (OPV2V's), and points of the own scan on the box. The grid ends
51.2 m ahead and aside, so beyond 50 m there are its corners."""


@dataclass(frozen=True, slots=True)
class PrecisionCounts:
    """Detections and true boxes of one class and group, by drive."""

    labels: tuple[Label, ...]
    """(U,) place and episode of each drive."""
    true: Int
    """(U, SCORE_STEPS + 1) true detections by score, the highest first."""
    found: Int
    """The same of all detections."""
    truths: Int
    """(U,) true boxes."""

    def resample(self) -> ResampledMean | None:
        """Return the average precision and those of resampled places and drives; None without true boxes."""
        if not self.truths.sum():
            return None
        counts = draw_nested_counts(self.labels)[: 1 + RESAMPLES_OF_AP]
        scores = np.flatnonzero(self.found.any(axis=0))  # the others change nothing
        true, found = (_sum_drives(counts, each[:, scores]) for each in (self.true, self.found))
        values = integrate_precision(true, found, sum_resamples(counts, self.truths.astype(np.float64)))
        units = len({label[0] for label in self.labels})
        return ResampledMean(float(values[0]), values[1:], units, count_effective(self.labels))


def _sum_drives(counts: Counts, histograms: Int) -> Float:
    """Return the sums (R, K) of histograms (U, K) of drives, of which drive u counts `counts[r, u]` times.

    Most of a histogram is 0, so this takes a tenth of the time of `sum_resamples`. Sums of whole numbers are exact.
    """
    sums = np.zeros((histograms.shape[1], len(counts)))
    for column, histogram in zip(counts.T, histograms, strict=True):
        bins = np.flatnonzero(histogram)
        sums[bins] += np.multiply.outer(histogram[bins], column.astype(np.int64))
    return sums.T


def count_detections(
    frames: FusionFrames, found: Sequence[DetectedBoxes], min_iou: float, class_number: int = 0
) -> dict[str, PrecisionCounts]:
    """Return the counts of each group of GROUPS. found: (F,) the detections of every frame, in the own frame.

    min_iou: intersection over union at which a detection counts. class_number: index into CLASSES; 0: vehicles.
    """
    drives = sorted(
        {(frames.places[place], int(episode)) for place, episode in zip(frames.place, frames.episode, strict=True)}
    )
    unit_by_drive = {drive: i for i, drive in enumerate(drives)}
    counts = {
        name: PrecisionCounts(tuple(drives), *_make_histograms(len(drives)), np.zeros(len(drives), np.int64))
        for name in GROUPS
    }
    for i, detected in enumerate(found):
        unit = unit_by_drive[frames.places[frames.place[i]], int(frames.episode[i])]
        rows = np.flatnonzero(frames.is_target[i] & (frames.box_class[i] == class_number))
        chosen = detected.classes == class_number
        truth = frames.boxes[i, rows].astype(np.float64)
        points = frames.box_points[i, rows, 0].astype(np.int64)
        _add_frame(counts, unit, detected.boxes[chosen], detected.scores[chosen], truth, points, min_iou)
    return counts


def _make_histograms(units: int) -> tuple[Int, Int]:
    shape = units, SCORE_STEPS + 1
    return np.zeros(shape, np.int64), np.zeros(shape, np.int64)


def _add_frame(
    counts: Mapping[str, PrecisionCounts],
    unit: int,
    boxes: Float,
    scores: Float,
    truth: Float,
    points: Int,
    min_iou: float,
) -> None:
    order = np.argsort(-scores, kind="stable")
    boxes, scores = boxes[order], scores[order]
    matches = match_boxes(compute_ious(boxes, truth), min_iou)
    is_true = matches >= 0
    bins = SCORE_STEPS - np.rint(SCORE_STEPS * scores).astype(np.int64)
    reach, own_reach = (portable.hypot(each[:, 0], each[:, 1]) for each in (truth, boxes))
    for name, group in GROUPS.items():
        is_inside = group.is_of_truth(reach, points)
        is_counted = np.where(is_true, np.append(is_inside, False)[matches], group.is_of_detection(own_reach))
        counts[name].truths[unit] += int(is_inside.sum())
        np.add.at(counts[name].found[unit], bins[is_counted], 1)
        np.add.at(counts[name].true[unit], bins[is_counted & is_true], 1)


def compute_precision(
    frames: FusionFrames, found: Sequence[DetectedBoxes], min_iou: float, group: str = "all"
) -> float:
    """Return the average precision of vehicles in one group without an interval; 0 without true boxes."""
    counts = count_detections(frames, found, min_iou)[group]
    return float(integrate_precision(counts.true.sum(axis=0), counts.found.sum(axis=0), counts.truths.sum()))
