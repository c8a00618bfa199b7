"""What a thing is and how large, by the vote of all who saw it."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from mdrive_sumo.core.state import Kind
from real2sim.clean.track_segments import Pieces
from real2sim.recording import USUAL_SIZE, Category

DISAGREE_M = 0.2
SMALLEST_M, LONGEST_M, WIDEST_M = 0.1, 40.0, 10.0
"""Sizes that a scenario can have; `WIDEST_M` is of vehicles, other things may be as wide as long."""


def bounded(length: float, width: float, kind: Kind) -> tuple[float, float]:
    """Length and width [m] within what a scenario can have, to the centimetre."""
    widest = WIDEST_M if kind is Kind.VEHICLE else LONGEST_M
    return min(max(round(length, 2), SMALLEST_M), LONGEST_M), min(max(round(width, 2), SMALLEST_M), widest)


def label_of(pieces: Pieces, members: Sequence[int]) -> tuple[Category, str]:
    """The label of most frames, and what to report if there were several. A CAV that nobody saw is a car."""
    votes: Counter[Category] = Counter()
    for i in members:
        votes[pieces.categories[i]] += int(pieces.valid[i].sum())
    if not votes:
        return Category.CAR, "connected vehicle that nobody else saw: car"
    winner = max(votes, key=lambda category: (votes[category], category.value))
    return winner, "" if len(votes) == 1 else "of " + ", ".join(sorted(category.value for category in votes))


def size_of(pieces: Pieces, members: Sequence[int], category: Category) -> tuple[float, float, str]:
    """Length and width [m], the median over all boxes, and what to report if they disagree, are assumed or odd."""
    rows = list(members)
    told: list[str] = []
    size: list[float] = []
    for name, values, usual in zip(
        ("length", "width"), (pieces.length, pieces.width), USUAL_SIZE[category], strict=True
    ):
        known = values[rows][np.isfinite(values[rows])] if rows else np.zeros(0)
        size.append(float(np.median(known)) if len(known) else usual)
        if len(known) == 0:
            told.append(f"{name} {usual:g} m assumed")
        elif category is not Category.PEDESTRIAN and np.ptp(known) > DISAGREE_M:
            told.append(f"{name} {known.min():.2f} to {known.max():.2f} m: {size[-1]:.2f}")
    within = bounded(size[0], size[1], category.kind)
    for name, value, limit in zip(("length", "width"), size, within, strict=True):
        if abs(value - limit) > 0.01:
            told.append(f"{name} {value:.2f} m is beyond what a scenario can have: {limit:g}")
            size[name == "width"] = limit
    return size[0], size[1], ", ".join(told)
