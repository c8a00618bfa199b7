"""Average precision against hand values and a second implementation."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from shapely import box
from shapely.affinity import rotate
from testing.sampling import examples

from mdrive_sumo.contract import Detections
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.open_loop import DetectionCounts, compute_average_precision
from mdrive_sumo.open_loop.detection_precision import MIN_IOU, match_frame
from mdrive_sumo.perception.box_iou import compute_ious

CAR = (4.0, 2.0)


def cars(*places: tuple[float, float]) -> Float:
    return np.array([(x, y, 0.0, *CAR) for x, y in places]).reshape(-1, 5)


def counts(found: Float, scores: list[float], truth: Float) -> DetectionCounts:
    return match_frame(Detections(found, np.array(scores)), truth)


def precision(found: Float, scores: list[float], truth: Float) -> float | None:
    return compute_average_precision(counts(found, scores, truth))


def test_hand_values() -> None:
    truth = cars((0, 0), (10, 0))
    assert precision(truth, [1.0, 1.0], truth) == 1.0
    assert precision(truth[:1], [1.0], truth) == 0.5
    assert precision(cars((50, 0)), [1.0], truth) == 0.0
    assert precision(cars(), [], truth) == 0.0
    assert precision(truth, [1.0, 1.0], cars()) is None
    # The most certain one is wrong: precision 1/2 and 2/3, interpolated 2/3 at all recalls.
    assert precision(cars((50, 0), (0, 0), (10, 0)), [0.9, 0.8, 0.7], truth) == pytest.approx(2 / 3)


def test_a_ground_truth_box_is_found_once() -> None:
    """Two detections of one car: the second is a false positive."""
    assert counts(cars((0, 0), (0.1, 0)), [0.9, 0.8], cars((0, 0))).by_score == {900: (1, 1), 800: (0, 1)}


def test_overlap_of_turned_boxes() -> None:
    """A square of 2 m turned by 45 degrees over itself: an octagon of 8 (sqrt(2) - 1) m2."""
    square = np.array([(0.0, 0.0, 0.0, 2.0, 2.0)])
    turned = np.array([(0.0, 0.0, math.pi / 4, 2.0, 2.0)])
    common = 8 * (math.sqrt(2) - 1)
    assert compute_ious(square, turned)[0, 0] == pytest.approx(common / (8 - common))


def slow_precision(frames: list[tuple[Float, list[float], Float]]) -> float:
    """The same by plain loops: VOC's sum over recall levels of the best precision at that recall or more."""
    rows: list[tuple[float, bool]] = []
    total = 0
    for found, scores, truth in frames:
        outlines = [
            rotate(box(x - w / 2, y - h / 2, x + w / 2, y + h / 2), a, use_radians=True) for x, y, a, w, h in truth
        ]
        taken: set[int] = set()
        total += len(truth)
        for i in sorted(range(len(scores)), key=lambda i: -scores[i]):
            x, y, a, w, h = found[i]
            own = rotate(box(x - w / 2, y - h / 2, x + w / 2, y + h / 2), a, use_radians=True)
            overlaps = [
                (own.intersection(other).area / own.union(other).area, -k)
                for k, other in enumerate(outlines)
                if k not in taken
            ]
            best, k = max(overlaps, default=(0.0, 0))
            if best >= MIN_IOU:
                taken.add(-k)
            rows.append((scores[i], best >= MIN_IOU))
    points: list[tuple[float, float]] = []
    for level in sorted({score for score, _ in rows}, reverse=True):
        accepted = [hit for score, hit in rows if score >= level]
        points.append((sum(accepted) / total, sum(accepted) / len(accepted)))
    area, before = 0.0, 0.0
    for recall, _ in points:
        area += (recall - before) * max(p for r, p in points if r >= recall)
        before = recall
    return area


PLACES = st.tuples(st.integers(0, 12), st.integers(0, 2), st.sampled_from([0.0, 0.3, 1.6]))
FRAME = st.tuples(st.lists(st.tuples(PLACES, st.integers(0, 10)), max_size=6), st.lists(PLACES, min_size=1, max_size=4))


def boxes(places: list[tuple[int, int, float]]) -> Float:
    return np.array([(0.5 * x, y, a, *CAR) for x, y, a in places]).reshape(-1, 5)


@settings(max_examples=examples(30, 300))
@given(st.lists(FRAME, min_size=1, max_size=3))
def test_equals_the_slow_implementation(
    drawn: list[tuple[list[tuple[tuple[int, int, float], int]], list[tuple[int, int, float]]]],
) -> None:
    frames = [(boxes([p for p, _ in found]), [s / 10 for _, s in found], boxes(truth)) for found, truth in drawn]
    summed = DetectionCounts()
    for frame in frames:
        summed.add(counts(*frame))
    assert compute_average_precision(summed) == pytest.approx(slow_precision(frames))
