"""Collisions, distances, spawn overlaps and remaining duplicates between the oriented boxes of tracks."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Bool, Float, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import Kind
from real2sim.recording import RecordedTrack

SAME_PLACE = 0.5
"""Share of the smaller box's area above which two overlapping boxes count as one object recorded twice; two separate
objects never overlap that much."""
SAME_SHARE = 0.5
"""Share of their common frames in which two boxes must overlap by `SAME_PLACE` to be duplicates."""


@dataclass(frozen=True)
class TrackBoxes:
    """The boxes of several tracks: arrays (K, T), NaN where a track is not valid."""

    x: Float
    y: Float
    yaw: Float
    length: Float
    width: Float

    @classmethod
    def from_tracks(cls, tracks: Sequence[RecordedTrack]) -> "TrackBoxes":
        """Return the boxes of tracks with the same number of frames and known sizes; an unknown yaw becomes 0."""
        valid = np.array([track.valid for track in tracks], dtype=np.bool_)
        x, y, yaw, length, width = (
            np.where(valid, np.array([getattr(track, name) for track in tracks], dtype=np.float64), np.nan)
            for name in ("x", "y", "yaw", "length", "width")
        )
        return cls(x, y, np.nan_to_num(yaw), length, width)

    def corners(self, track: np.ndarray, frame: np.ndarray, shrink: float = 0.0) -> Float:
        """Return the corners (N, 4, 2) [m] of the boxes at (track, frame) (N,), each side moved inwards by `shrink`
        [m]."""
        cell = (track, frame)
        sides = (np.maximum(size[cell] - 2 * shrink, 0.05) for size in (self.length, self.width))
        return boxes_corners(self.x[cell], self.y[cell], self.yaw[cell], *sides)

    def find_near_pairs(self, margin: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return first track, second track and frame (N,) of all pairs whose circumscribed circles are less than
        `margin` [m] apart."""
        first, second = np.triu_indices(len(self.x), 1)
        reach = np.nanmax(np.hypot(self.length, self.width), axis=1) / 2 if len(self.x) else np.zeros(0)
        apart = np.hypot(self.x[first] - self.x[second], self.y[first] - self.y[second])
        pair, frame = np.nonzero(apart < (reach[first] + reach[second] + margin)[:, None])
        return first[pair], second[pair], frame


@dataclass(frozen=True)
class TrackContacts:
    """Contacts between tracks; indices refer to the sequence of tracks."""

    collisions: tuple[tuple[int, int, int], ...]
    """First track, second track, number of frames in which their boxes overlap."""
    spawn_overlaps: tuple[tuple[int, int], ...]
    """First and second track: one of them appears inside the other."""
    duplicates: tuple[tuple[int, int], ...]
    """First and second track: one object under two ids. A pedestrian who leaves a car is not a duplicate."""
    least_distance_m: float
    """Between any two boxes in any frame; infinite with less than two boxes."""
    close_frames: int
    """Number of (pair, frame) less than 1 m apart."""


def find_contacts(tracks: Sequence[RecordedTrack], slack_m: float = 0.0) -> TrackContacts:
    """Compare all pairs of tracks in all frames; for collisions and spawn overlaps each box side is moved inwards by
    `slack_m` [m]."""
    boxes = TrackBoxes.from_tracks(tracks)
    first, second, frame = boxes.find_near_pairs(1.0)
    if len(first) == 0:
        return TrackContacts((), (), (), _bound_distance(boxes), 0)
    hit = boxes_overlap(boxes.corners(first, frame, slack_m), boxes.corners(second, frame, slack_m))
    a, b = (np.asarray(shapely.polygons(boxes.corners(side, frame))) for side in (first, second))
    distance = shapely.distance(a, b)
    spawn = hit & (_first_frames(boxes)[first] == frame) | hit & (_first_frames(boxes)[second] == frame)
    shared = shapely.area(shapely.intersection(a, b)) / np.minimum(shapely.area(a), shapely.area(b))
    walker = np.array([track.category.kind is Kind.PEDESTRIAN for track in tracks], dtype=np.bool_)
    alike = walker[first] == walker[second]
    counted = _count_frames_by_pair(first[hit], second[hit])
    return TrackContacts(
        tuple((i, j, n) for (i, j), n in counted.items()),
        tuple(_count_frames_by_pair(first[spawn], second[spawn])),
        _find_duplicates(boxes, first, second, alike & (shared > SAME_PLACE)),
        float(distance.min()),
        int((distance < 1.0).sum()),
    )


def _first_frames(boxes: TrackBoxes) -> np.ndarray:
    return np.isfinite(boxes.x).argmax(1)


def _count_frames_by_pair(first: np.ndarray, second: np.ndarray) -> dict[tuple[int, int], int]:
    if len(first) == 0:
        return {}
    pairs, counts = np.unique(np.column_stack((first, second)), axis=0, return_counts=True)
    return {(int(i), int(j)): int(n) for (i, j), n in zip(pairs, counts, strict=True)}


def _find_duplicates(
    boxes: TrackBoxes, first: np.ndarray, second: np.ndarray, same: Bool
) -> tuple[tuple[int, int], ...]:
    there = np.isfinite(boxes.x)
    return tuple(
        pair
        for pair, n in _count_frames_by_pair(first[same], second[same]).items()
        if n >= SAME_SHARE * (there[pair[0]] & there[pair[1]]).sum()
    )


def _bound_distance(boxes: TrackBoxes) -> float:
    """Return a lower bound of the distance [m] from centres and circumscribed circles, for tracks that never come near
    each other."""
    first, second = np.triu_indices(len(boxes.x), 1)
    apart = np.hypot(boxes.x[first] - boxes.x[second], boxes.y[first] - boxes.y[second])
    if not np.isfinite(apart).any():
        return float("inf")
    radius = np.nanmax(np.hypot(boxes.length, boxes.width), axis=1) / 2
    return float(np.nanmin(apart - (radius[first] + radius[second])[:, None]))
