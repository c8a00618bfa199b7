"""How close things come to each other: collisions of oriented boxes, distances, spawn overlaps, duplicates left."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Bool, Float, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import Kind
from real2sim.recording import RecordedTrack

SAME_PLACE = 0.5
"""Share of the smaller box's area that two boxes must share to be one thing seen twice; two real things never do."""
SAME_SHARE = 0.5
"""... in at least this share of their common frames."""


@dataclass(frozen=True)
class TrackBoxes:
    """All boxes of some tracks: arrays (K, T), NaN where a track is not there."""

    x: Float
    y: Float
    yaw: Float
    length: Float
    width: Float

    @classmethod
    def from_tracks(cls, tracks: Sequence[RecordedTrack]) -> "TrackBoxes":
        """Boxes of tracks with the same number of frames and known sizes; an unknown yaw is 0."""
        valid = np.array([track.valid for track in tracks], dtype=np.bool_)
        x, y, yaw, length, width = (
            np.where(valid, np.array([getattr(track, name) for track in tracks], dtype=np.float64), np.nan)
            for name in ("x", "y", "yaw", "length", "width")
        )
        return cls(x, y, np.nan_to_num(yaw), length, width)

    def corners(self, track: np.ndarray, frame: np.ndarray, shrink: float = 0.0) -> Float:
        """Corners (N, 4, 2) of the boxes at (track, frame) (N,), each side `shrink` metres in."""
        at = (track, frame)
        sides = (np.maximum(size[at] - 2 * shrink, 0.05) for size in (self.length, self.width))
        return boxes_corners(self.x[at], self.y[at], self.yaw[at], *sides)

    def find_near_pairs(self, margin: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """First, second and frame (N,) of every pair whose circumscribed circles are less than `margin` [m] apart."""
        first, second = np.triu_indices(len(self.x), 1)
        reach = np.nanmax(np.hypot(self.length, self.width), axis=1) / 2 if len(self.x) else np.zeros(0)
        apart = np.hypot(self.x[first] - self.x[second], self.y[first] - self.y[second])
        pair, frame = np.nonzero(apart < (reach[first] + reach[second] + margin)[:, None])
        return first[pair], second[pair], frame


@dataclass(frozen=True)
class TrackContacts:
    """What happens between tracks. Indices count the tracks as they were given."""

    collisions: tuple[tuple[int, int, int], ...]
    """First, second, frames in which their boxes share area."""
    spawn_overlaps: tuple[tuple[int, int], ...]
    """First, second: one of them appears inside the other."""
    duplicates: tuple[tuple[int, int], ...]
    """First, second: one thing under two names. A walker who gets out of a car is none."""
    least_distance_m: float
    """Between any two boxes at any frame; infinite with less than two."""
    close_frames: int
    """Pairs of boxes and frames less than 1 m apart."""


def find_contacts(tracks: Sequence[RecordedTrack], slack_m: float = 0.0) -> TrackContacts:
    """Looks at all pairs and frames; boxes count `slack_m` [m] smaller on each side for collisions and spawns."""
    boxes = TrackBoxes.from_tracks(tracks)
    first, second, frame = boxes.find_near_pairs(1.0)
    if len(first) == 0:
        return TrackContacts((), (), (), _least_centres(boxes), 0)
    hit = boxes_overlap(boxes.corners(first, frame, slack_m), boxes.corners(second, frame, slack_m))
    a, b = (np.asarray(shapely.polygons(boxes.corners(side, frame))) for side in (first, second))
    distance = shapely.distance(a, b)
    spawn = hit & (_first_frames(boxes)[first] == frame) | hit & (_first_frames(boxes)[second] == frame)
    shared = shapely.area(shapely.intersection(a, b)) / _smaller(a, b)
    walker = np.array([track.category.kind is Kind.PEDESTRIAN for track in tracks], dtype=np.bool_)
    alike = walker[first] == walker[second]
    counted = _per_pair(first[hit], second[hit])
    return TrackContacts(
        tuple((i, j, n) for (i, j), n in counted.items()),
        tuple(_per_pair(first[spawn], second[spawn])),
        _duplicates(boxes, first, second, alike & (shared > SAME_PLACE)),
        float(distance.min()),
        int((distance < 1.0).sum()),
    )


def _smaller(a: np.ndarray, b: np.ndarray) -> Float:
    return np.minimum(shapely.area(a), shapely.area(b))


def _first_frames(boxes: TrackBoxes) -> np.ndarray:
    return np.isfinite(boxes.x).argmax(1)


def _per_pair(first: np.ndarray, second: np.ndarray) -> dict[tuple[int, int], int]:
    if len(first) == 0:
        return {}
    pairs, counts = np.unique(np.column_stack((first, second)), axis=0, return_counts=True)
    return {(int(i), int(j)): int(n) for (i, j), n in zip(pairs, counts, strict=True)}


def _duplicates(boxes: TrackBoxes, first: np.ndarray, second: np.ndarray, same: Bool) -> tuple[tuple[int, int], ...]:
    there = np.isfinite(boxes.x)
    return tuple(
        pair
        for pair, n in _per_pair(first[same], second[same]).items()
        if n >= SAME_SHARE * (there[pair[0]] & there[pair[1]]).sum()
    )


def _least_centres(boxes: TrackBoxes) -> float:
    """Without boxes near each other the least distance of centres stands in, less both circles: never too large."""
    first, second = np.triu_indices(len(boxes.x), 1)
    apart = np.hypot(boxes.x[first] - boxes.x[second], boxes.y[first] - boxes.y[second])
    if not np.isfinite(apart).any():
        return float("inf")
    radius = np.nanmax(np.hypot(boxes.length, boxes.width), axis=1) / 2
    return float(np.nanmin(apart - (radius[first] + radius[second])[:, None]))
