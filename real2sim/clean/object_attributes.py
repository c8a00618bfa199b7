"""Category and size of an object by majority and median over all observers."""

from collections import Counter
from collections.abc import Sequence

import numpy as np

from mdrive_sumo.core.state import Kind
from real2sim.clean.track_segments import TrackSegments
from real2sim.percentile import compute_median
from real2sim.recording import DEFAULT_SIZE_M, ObjectCategory

DISAGREE_M = 0.2
"""[m] Chosen: sizes that differ by more between observers get a note."""
MIN_SIZE_M, MAX_LENGTH_M, MAX_VEHICLE_WIDTH_M = 0.1, 40.0, 10.0
"""Limits of a scenario; `MAX_VEHICLE_WIDTH_M` applies to vehicles, other objects may be as wide as long."""


def clamp_size(length: float, width: float, kind: Kind) -> tuple[float, float]:
    """Clamp length and width [m] to the limits of a scenario, rounded to a centimetre."""
    widest = MAX_VEHICLE_WIDTH_M if kind is Kind.VEHICLE else MAX_LENGTH_M
    return min(max(round(length, 2), MIN_SIZE_M), MAX_LENGTH_M), min(max(round(width, 2), MIN_SIZE_M), widest)


def vote_category(segments: TrackSegments, members: Sequence[int]) -> tuple[ObjectCategory, str]:
    """Return the category of most frames, and a note if there were several. A CAV without observers is a car."""
    votes: Counter[ObjectCategory] = Counter()
    for i in members:
        votes[segments.categories[i]] += int(segments.valid[i].sum())
    if not votes:
        return ObjectCategory.CAR, "connected vehicle without another observer: car"
    winner = max(votes, key=lambda category: (votes[category], category.value))
    return winner, "" if len(votes) == 1 else "of " + ", ".join(sorted(category.value for category in votes))


def vote_size(segments: TrackSegments, members: Sequence[int], category: ObjectCategory) -> tuple[float, float, str]:
    """Return the median length and width [m], and a note if they disagree, are assumed or out of limits."""
    rows = list(members)
    notes: list[str] = []
    size: list[float] = []
    for name, values, usual in zip(
        ("length", "width"), (segments.length, segments.width), DEFAULT_SIZE_M[category], strict=True
    ):
        measured = values[rows][np.isfinite(values[rows])] if rows else np.zeros(0)
        size.append(compute_median(measured) if len(measured) else usual)
        if len(measured) == 0:
            notes.append(f"{name} {usual:g} m assumed")
        elif category is not ObjectCategory.PEDESTRIAN and np.ptp(measured) > DISAGREE_M:
            notes.append(f"{name} {measured.min():.2f} to {measured.max():.2f} m: {size[-1]:.2f}")
    within = clamp_size(size[0], size[1], category.kind)
    for name, value, limit in zip(("length", "width"), size, within, strict=True):
        if abs(value - limit) > 0.01:
            notes.append(f"{name} {value:.2f} m is outside the limits of a scenario: {limit:g}")
            size[name == "width"] = limit
    return size[0], size[1], ", ".join(notes)
