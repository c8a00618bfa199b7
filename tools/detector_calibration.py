"""Average precision of the detection profiles on a random reference scene, and the fit to published figures.

The reference, in which only the order of magnitude is that of V2XSet: `CARS` cars of 4.5 m x 1.9 m a frame, placed
uniformly in the area of OpenCOOD's LiDAR configurations (281.6 m x 76.8 m around the observer), nowhere closer than
6 m to each other; `PLAIN` of them are wholly visible, the others in a share that is uniform in [0.1, 1]. For a single
vehicle `hidden` of all are not visible at all; partners see those for a detector that fuses. Detections have no
confidence in this project: the nearer one is ranked first. Average precision is that of protocol 13.3: bird's-eye
intersection over union of the boxes, greedy matching, all-point interpolation.

    python -m tools.detector_calibration [PROFILE]...
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache

import click
import numpy as np
import numpy.typing as npt
import shapely

from mdrive_sumo.contract import Objects
from mdrive_sumo.contract.detector_profiles import PROFILES, PUBLISHED, DetectionProfile, PublishedPrecision
from mdrive_sumo.core.geometry import Bool, Float, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.sensing.detection_noise import (
    CAR_M,
    EPOCH_TICKS,
    add_errors,
    build_false_positives,
    draw_detected,
    draw_false_positives,
)
from tools.tool_command import HELP, ToolCommand

FRAMES = 800
CARS = 12
PLAIN = 0.7
"""Share of cars that are wholly visible, an assumption."""
HALF_AREA_M = (140.8, 38.4)
"""Half the length and half the width of the area."""
APART_M = 6.0
"""[m] Least distance between two cars, so that a detection belongs to one of them."""
HIDDEN_FROM_ONE = 0.25
"""Share of cars that a single vehicle does not see at all, an assumption."""
HERE = (0.0, 0.0)


def measure_average_precision(profile: DetectionProfile, iou: float, seed: int, hidden: float = 0.0) -> float:
    """Return the average precision in [0, 1] of simulated detections at an IoU threshold in (0, 1]."""
    frames = _compare_frames(profile, seed, hidden)
    hits = np.concatenate([_match(overlap, iou) for _, overlap in frames])
    return _compute_average_precision(np.concatenate([-distance for distance, _ in frames]), hits, FRAMES * CARS)


@lru_cache(maxsize=1)
def _compare_frames(profile: DetectionProfile, seed: int, hidden: float) -> tuple[tuple[Float, Float], ...]:
    """For every frame: distances (M,) [m] of the detections, and their overlaps (M, CARS) with the truth."""
    frames = tuple(_simulate_frames(profile, seed, hidden))
    return tuple((np.hypot(detected.x, detected.y), _compute_overlaps(detected, truth)) for truth, detected in frames)


def _simulate_frames(profile: DetectionProfile, seed: int, hidden: float) -> Iterator[tuple[Objects, Objects]]:
    """Truth and detections, nearest first, of every frame; frames are so far apart in time that nothing lasts."""
    rng = np.random.default_rng(seed)
    for frame in range(FRAMES):
        truth, tick = _draw_cars(rng, frame), frame * 4 * EPOCH_TICKS
        visible = np.where(rng.random(CARS) < PLAIN, 1.0, rng.uniform(0.1, 1.0, CARS))
        visible[rng.random(CARS) < hidden] = 0.0
        recall = profile.recall_at(np.hypot(truth.x, truth.y), visible)
        seen = truth.take(draw_detected(seed, tick, truth.ids, recall))
        ghosts = build_false_positives(draw_false_positives(profile, seed, tick, HERE, HALF_AREA_M[0]))
        ghosts = ghosts.take(np.abs(ghosts.y) <= HALF_AREA_M[1])
        detected = add_errors(profile, seed, tick, seen, HERE).concat(ghosts)
        yield truth, detected.take(np.argsort(np.hypot(detected.x, detected.y), kind="stable"))


def _draw_cars(rng: np.random.Generator, frame: int) -> Objects:
    places: list[Float] = []
    while len(places) < CARS:
        place = rng.uniform(-1.0, 1.0, 2) * HALF_AREA_M
        if all(np.hypot(*(place - other)) >= APART_M for other in places):
            places.append(place)
    x, y = np.array(places).T
    length, width = np.full(CARS, CAR_M[0]), np.full(CARS, CAR_M[1])
    ids = tuple(f"{frame} {i}" for i in range(CARS))
    kind = np.full(CARS, Kind.VEHICLE, dtype=np.uint8)
    return Objects(ids, kind, x, y, rng.uniform(-np.pi, np.pi, CARS), np.zeros(CARS), length, width)


def _compute_overlaps(detected: Objects, truth: Objects) -> Float:
    """(M, N) intersection over union of detected and true boxes."""
    overlap = np.zeros((len(detected.ids), len(truth.ids)))
    i, j = np.nonzero(np.hypot(detected.x[:, None] - truth.x, detected.y[:, None] - truth.y) < APART_M)
    first, second = _to_polygons(detected)[i], _to_polygons(truth)[j]
    shared = shapely.area(shapely.intersection(first, second))
    overlap[i, j] = shared / (shapely.area(first) + shapely.area(second) - shared)
    return overlap


def _to_polygons(boxes: Objects) -> npt.NDArray[np.object_]:
    corners = boxes_corners(boxes.x, boxes.y, boxes.yaw, boxes.length, boxes.width)
    return np.array(shapely.polygons(corners), dtype=object)


def _match(overlaps: Float, iou: float) -> Bool:
    """Return (M,) whether each detection, nearest first, matches a true box that no earlier detection matched."""
    free = overlaps.copy()
    hits = np.zeros(len(free), dtype=np.bool_)
    for i, row in enumerate(free):
        best = int(np.argmax(row))
        if row[best] >= iou:
            hits[i] = True
            free[:, best] = 0.0
    return hits


def _compute_average_precision(scores: Float, hits: Bool, truths: int) -> float:
    """Area under the precision that is at least reached at each recall (VOC 2010)."""
    ranked = hits[np.argsort(-scores, kind="stable")]
    right = np.cumsum(ranked)
    precision = right / np.arange(1, len(ranked) + 1)
    envelope = np.maximum.accumulate(precision[::-1])[::-1]
    return float(envelope[ranked].sum() / truths)


def fit_profile(
    profile: DetectionProfile, target: PublishedPrecision, seed: int, hidden: float = 0.0
) -> DetectionProfile:
    """Return the profile with recall and spread for which its average precision is the published one.

    Recall determines the value at 0.5, spread that at 0.7; both are found by alternating bisection.
    """
    for _ in range(3):
        for_recall = profile
        recall = _bisect(
            lambda value, p=for_recall: (
                measure_average_precision(replace(p, recall=value), 0.5, seed, hidden) - target.ap50
            ),
            0.3,
            1.0,
        )
        profile = for_spread = replace(profile, recall=round(recall, 3))
        spread = _bisect(
            lambda value, p=for_spread: (
                target.ap70 - measure_average_precision(replace(p, spread=value), 0.7, seed, hidden)
            ),
            0.01,
            1.0,
        )
        profile = replace(profile, spread=round(spread, 3))
    return profile


def _bisect(rising: Callable[[float], float], low: float, high: float) -> float:
    """Return the zero of an increasing function, or the nearer bound."""
    for _ in range(8):
        middle = (low + high) / 2
        low, high = (low, middle) if rising(middle) > 0.0 else (middle, high)
    return (low + high) / 2


@click.command(cls=ToolCommand, context_settings=HELP)
@click.argument("profiles", nargs=-1, type=click.Choice(tuple(PUBLISHED)), metavar="[PROFILE]...")
def main(profiles: Sequence[str]) -> None:
    """Fit recall and spread of the named profiles, or of all, to the published figures, and print them."""
    for name in profiles or PUBLISHED:
        stored = PROFILES[name]
        hidden = HIDDEN_FROM_ONE if name == "lidar-single" else 0.0  # partners see what one vehicle does not
        fitted = fit_profile(stored, PUBLISHED[name], 0, hidden)
        echo(f"{name}: recall {fitted.recall}, spread {fitted.spread}; stored {stored.recall}, {stored.spread}")


if __name__ == "__main__":
    main()
