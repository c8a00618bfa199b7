"""Decoding of boxes, late fusion, and average precision against an independent implementation."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from shapely import Polygon, affinity, box

from mdrive_sumo.agents.learned.box_decoding import MAX_IOU, DetectedBoxes, decode_boxes, merge_boxes
from mdrive_sumo.agents.learned.fusion_spec import BOX_NUMBERS, CLASSES, OUTPUT_CELLS
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.learning.fusion.average_precision import GROUPS, compute_precision, count_detections
from mdrive_sumo.learning.fusion.frames import FusionFrames
from mdrive_sumo.learning.fusion.synthetic_frames import build_synthetic_frames
from mdrive_sumo.perception.box_iou import compute_ious, suppress_overlaps

Float = np.ndarray[Any, np.dtype[np.float64]]


def make_maps(*found: tuple[float, float, float, float, float, float]) -> tuple[Any, Any]:
    """Maps of vehicles with x, y, yaw, length, width, score, as the head should answer them."""
    scores = np.zeros((len(CLASSES), OUTPUT_CELLS, OUTPUT_CELLS), np.float32)
    numbers = np.zeros((BOX_NUMBERS, OUTPUT_CELLS, OUTPUT_CELLS), np.float32)
    for x, y, yaw, length, width, score in found:
        row, column = int((51.2 - x) / 0.8), int((51.2 - y) / 0.8)
        offset = x - (51.2 - (row + 0.5) * 0.8), y - (51.2 - (column + 0.5) * 0.8)
        ahead = 1.0 if np.cos(yaw - np.pi / 4) > 0 else -1.0
        scores[0, row, column] = score
        numbers[:, row, column] = (
            *offset, np.log(length), np.log(width), np.cos(2 * yaw), np.sin(2 * yaw), ahead
        )  # fmt: skip
    return scores, numbers


@given(st.floats(-51, 51), st.floats(-51, 51), st.floats(-3.14, 3.14), st.floats(0.5, 12), st.floats(0.5, 3))
def test_a_box_comes_back_with_its_heading(x: float, y: float, yaw: float, length: float, width: float) -> None:
    found = decode_boxes(*make_maps((x, y, yaw, length, width, 0.9)))
    assert found.boxes[0, [0, 1, 3, 4]] == pytest.approx((x, y, length, width), abs=1e-4)
    turn = abs(wrap_angle(float(found.boxes[0, 2]) - yaw))
    edge = abs(np.cos(yaw - np.pi / 4)) < 1e-3  # where the number that tells both ends apart changes its sign
    assert turn < 1e-3 or (edge and abs(turn - np.pi) < 1e-2)


def test_peaks_are_found_once_and_overlaps_are_dropped() -> None:
    scores, numbers = make_maps((10, 0, 0, 4.5, 1.9, 0.9), (12, 0, 0, 4.5, 1.9, 0.6), (30, 0, 0, 4.5, 1.9, 0.5))
    scores[0] = np.maximum(scores[0], 0.5 * np.roll(scores[0], 1, axis=0))  # slopes beside peaks
    scores[2] = scores[0]  # another class may stand in the same place
    found = decode_boxes(scores, numbers)
    assert found.boxes[:, 0] == pytest.approx((10, 10, 30, 30)) and found.classes.tolist() == [0, 2, 0, 2]
    assert found.scores == pytest.approx((0.9, 0.9, 0.5, 0.5))
    assert len(decode_boxes(np.zeros_like(scores), numbers).scores) == 0


def test_kept_boxes_never_overlap_more_than_allowed() -> None:
    random = np.random.default_rng(0)
    boxes = np.column_stack(
        (random.uniform(-9, 9, (60, 2)), random.uniform(-3, 3, 60), np.full(60, 4.5), np.full(60, 2.0))
    )
    scores = random.random(60)
    kept = suppress_overlaps(boxes, scores, np.zeros(60, np.int64), MAX_IOU)
    overlaps = compute_ious(boxes[kept], boxes[kept]) - np.eye(len(kept))
    assert overlaps.max() <= MAX_IOU and (np.diff(scores[kept]) <= 0).all()
    dropped = np.setdiff1d(np.arange(60), kept)
    better = compute_ious(boxes[dropped], boxes[kept]) * (scores[kept] >= scores[dropped][:, None])
    assert (better.max(axis=1) > MAX_IOU).all()


def test_late_fusion_moves_boxes_and_keeps_the_most_certain() -> None:
    own = DetectedBoxes(np.array([(10.0, 0.0, 0.0, 4.5, 1.9)]), np.array([0]), np.array([0.6]))
    same = DetectedBoxes(
        np.array([(10.1, 0.0, np.pi, 4.5, 1.9), (5.0, 1.0, 0.0, 4.5, 1.9), (-40.0, 0.0, 0.0, 4.5, 1.9)]),
        np.array([0, 0, 0]),
        np.array([0.8, 0.5, 0.9]),
    )
    merged = merge_boxes([own, same], np.array([(0.0, 0.0, 0.0), (20.0, 0.0, np.pi)]))
    assert merged.boxes[:, :2] == pytest.approx(np.array([(9.9, 0.0), (15.0, -1.0)]), abs=1e-9)
    assert merged.scores.tolist() == [0.8, 0.5] and wrap_angle(float(merged.boxes[0, 2])) == pytest.approx(0, abs=1e-9)


def polygon_of(row: Float) -> Polygon:
    x, y, yaw, length, width = row
    flat = box(-length / 2, -width / 2, length / 2, width / 2)
    return affinity.translate(affinity.rotate(flat, yaw, origin=(0, 0), use_radians=True), x, y)


def judge_apart(frames: FusionFrames, found: list[DetectedBoxes], min_iou: float) -> float:
    """Average precision written anew: one list of all detections, matched in the order of their scores over the set."""
    rows = [
        (-round(float(score), 3), i, j)
        for i, each in enumerate(found)
        for j, score in enumerate(each.scores)
        if each.classes[j] == 0
    ]
    truth = [
        [polygon_of(row) for row in frames.boxes[i][frames.is_target[i] & (frames.box_class[i] == 0)].astype(float)]
        for i in range(len(frames))
    ]
    taken, outcome = set[tuple[int, int]](), list[tuple[float, bool]]()
    for score, i, j in sorted(rows):
        shape = polygon_of(found[i].boxes[j])
        ious = [
            -1.0 if (i, k) in taken else shape.intersection(other).area / shape.union(other).area
            for k, other in enumerate(truth[i])
        ]
        best = max(range(len(ious)), key=ious.__getitem__, default=-1)
        is_true = best >= 0 and ious[best] >= min_iou
        if is_true:
            taken.add((i, best))
        outcome.append((score, is_true))
    total = sum(map(len, truth))
    points = list[tuple[float, float]]()
    for score in sorted({score for score, _ in outcome}):
        accepted = [true for s, true in outcome if s <= score]
        points.append((sum(accepted) / total, sum(accepted) / len(accepted)))
    area, before = 0.0, 0.0
    for k, (recall, _) in enumerate(points):
        area += (recall - before) * max(precision for _, precision in points[k:])
        before = recall
    return area


@pytest.fixture(scope="module")
def frames() -> FusionFrames:
    return build_synthetic_frames(48, 3)


def make_detections(frames: FusionFrames, seed: int) -> list[DetectedBoxes]:
    """True boxes with errors, some missing, and others that are made up."""
    random = np.random.default_rng(seed)
    found = list[DetectedBoxes]()
    for i in range(len(frames)):
        rows = np.flatnonzero(frames.is_target[i] & (random.random(len(frames.boxes[i])) < 0.7))
        boxes = frames.boxes[i, rows].astype(float)
        boxes[:, :2] += random.normal(0, 0.35, (len(rows), 2))
        false = np.column_stack(
            (random.uniform(-50, 50, (3, 2)), random.uniform(-3, 3, 3), np.tile((4.5, 1.9), (3, 1)))
        )
        classes = np.concatenate((frames.box_class[i, rows].astype(np.int64), np.zeros(3, np.int64)))
        scores = np.concatenate((random.uniform(0.3, 1, len(rows)), random.uniform(0.1, 0.7, 3)))
        found.append(DetectedBoxes(np.concatenate((boxes, false)), classes, scores))
    return found


@pytest.mark.parametrize("min_iou", [0.5, 0.7])
def test_precision_is_that_of_an_independent_implementation(frames: FusionFrames, min_iou: float) -> None:
    found = make_detections(frames, 0)
    value = compute_precision(frames, found, min_iou)
    assert 0.05 < value < 0.9
    assert value == pytest.approx(judge_apart(frames, found, min_iou), abs=1e-9)


def test_scores_are_sorted_over_the_whole_set_and_not_by_frame(frames: FusionFrames) -> None:
    """Errors of one frame cost more with high scores than with low ones, though the order in each frame stays."""
    truth = frames.boxes.astype(float)
    rows = [np.flatnonzero(frames.is_target[i] & (frames.box_class[i] == 0)) for i in range(len(frames))]
    good = [
        DetectedBoxes(truth[i, row], np.zeros(len(row), np.int64), np.full(len(row), 0.5)) for i, row in enumerate(rows)
    ]
    wrong = DetectedBoxes(
        truth[0, rows[0]] + (60, 60, 0, 0, 0), np.zeros(len(rows[0]), np.int64), np.full(len(rows[0]), 0.9)
    )
    sure, unsure = ([wrong, *good[1:]], [DetectedBoxes(wrong.boxes, wrong.classes, wrong.scores / 9), *good[1:]])
    assert compute_precision(frames, good, 0.5) == pytest.approx(1.0)
    assert compute_precision(frames, sure, 0.5) < compute_precision(frames, unsure, 0.5) < 1.0


def test_groups_share_the_true_boxes(frames: FusionFrames) -> None:
    counts = count_detections(frames, make_detections(frames, 1), 0.5)
    truths = {name: int(each.truths.sum()) for name, each in counts.items()}
    assert truths["0-30 m"] + truths["30-50 m"] + truths["50-100 m"] == truths["all"] > 0
    assert truths["0 points"] + truths["1-5 points"] + truths["more points"] == truths["all"]
    assert truths["0 points"] > 0 and set(counts) == set(GROUPS)
    true = {name: int(each.true.sum()) for name, each in counts.items()}
    assert true["0 points"] + true["1-5 points"] + true["more points"] == true["all"]
    false = {name: int(each.found.sum()) - true[name] for name, each in counts.items()}
    assert false["0 points"] == false["all"] == false["0-30 m"] + false["30-50 m"] + false["50-100 m"]


def test_intervals_are_over_places_and_pairs_are_narrower(frames: FusionFrames) -> None:
    counts = count_detections(frames, make_detections(frames, 2), 0.5)
    better, worse = counts["all"].resample(), counts["0-30 m"].resample()
    assert better is not None and worse is not None
    interval = better.make_interval()
    assert interval.units == 12 and interval.ends is not None
    assert interval.ends[0] < interval.mean < interval.ends[1]
    assert interval.mean == pytest.approx(compute_precision(frames, make_detections(frames, 2), 0.5))
    assert better.subtract(better).ends == (0.0, 0.0)  # the same places are drawn for both
    apart, paired = (better.make_interval(), worse.make_interval()), better.subtract(worse)
    assert paired.ends is not None and all(each.ends is not None for each in apart)
    assert paired.ends[1] - paired.ends[0] < sum(each.ends[1] - each.ends[0] for each in apart if each.ends)
    assert replace(counts["all"], truths=np.zeros(12, np.int64)).resample() is None
