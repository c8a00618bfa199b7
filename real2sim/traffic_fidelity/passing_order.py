"""Conflict points: where the paths of two vehicles cross or merge, and which vehicle passes first."""

from collections.abc import Mapping
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from mdrive_sumo.core.geometry import Float, build_polyline

CONFLICT_M = 1.5
"""[m] Paths this near to one another cannot be driven at the same time."""
APART_M = 3.0
"""[m] A path that is near the other within its first metres begins there: the vehicle follows, it does not merge."""
SPACING_M = 0.5
"""[m] Distance between the points of a path."""
MIN_PATH_M = 2.0
"""[m] A vehicle that drives less has no path."""


@dataclass(frozen=True, slots=True)
class ConflictPoint:
    """A conflict point of two vehicles: in the log `first` passed it before `second`; x, y [m] on both paths."""

    first: str
    second: str
    first_at: tuple[float, float]
    second_at: tuple[float, float]


@dataclass(frozen=True)
class _DrivenPath:
    """The path of a vehicle: points (N, 2) [m] every `SPACING_M`, and the time [frames] at each."""

    xy: Float
    frame: Float
    low: Float
    high: Float
    """Corners (2,) [m] of the box around the points."""


def find_conflict_points(tracks: Mapping[str, Float]) -> tuple[ConflictPoint, ...]:
    """Return the conflict points of all pairs of vehicles; positions (T, 2) [m] by name, NaN where a vehicle is
    absent."""
    paths = {name: path for name, xy in sorted(tracks.items()) if (path := _sample_path(xy)) is not None}
    points: list[ConflictPoint] = []
    for a, b in combinations(paths, 2):
        meeting = _find_meeting_point(paths[a], paths[b])
        if meeting is None:
            continue
        i, j = meeting
        first, second, k, n = (a, b, i, j) if paths[a].frame[i] <= paths[b].frame[j] else (b, a, j, i)
        points.append(ConflictPoint(first, second, _xy(paths[first], k), _xy(paths[second], n)))
    return tuple(points)


def _xy(path: _DrivenPath, k: int) -> tuple[float, float]:
    return float(path.xy[k, 0]), float(path.xy[k, 1])


def _sample_path(xy: Float) -> _DrivenPath | None:
    rows = np.flatnonzero(np.isfinite(xy[:, 0]))
    if len(rows) < 2:
        return None
    driven = np.concatenate(((0.0,), np.cumsum(np.hypot(*np.diff(xy[rows], axis=0).T))))
    if driven[-1] < MIN_PATH_M:
        return None
    stations = np.arange(0.0, driven[-1], SPACING_M)
    points = np.column_stack([np.interp(stations, driven, xy[rows, axis]) for axis in (0, 1)])
    first_there = np.concatenate(((True,), np.diff(driven) > 1e-6))
    frame = np.interp(stations, driven[first_there], rows[first_there].astype(np.float64))
    return _DrivenPath(points, frame, points.min(axis=0), points.max(axis=0))


def _find_meeting_point(path: _DrivenPath, other: _DrivenPath) -> tuple[int, int] | None:
    """Return the indices of the points at which two paths first come near each other after a stretch apart."""
    if np.any(path.low > other.high + CONFLICT_M) or np.any(other.low > path.high + CONFLICT_M):
        return None
    square = (path.xy[:, None, 0] - other.xy[:, 0]) ** 2 + (path.xy[:, None, 1] - other.xy[:, 1]) ** 2
    is_near = square < CONFLICT_M**2
    if not is_near.any():
        return None
    i, j = int(is_near.any(axis=1).argmax()), int(is_near.any(axis=0).argmax())
    apart = round(APART_M / SPACING_M)
    return (i, j) if i >= apart and j >= apart else None


def is_order_kept(conflict: ConflictPoint, log: Mapping[str, Float], simulated: Mapping[str, Float]) -> bool:
    """Return whether `first` passes the point before `second` in the simulation too; False if neither passes."""
    first = _find_passing_frame(log[conflict.first], simulated[conflict.first], conflict.first_at)
    second = _find_passing_frame(log[conflict.second], simulated[conflict.second], conflict.second_at)
    return first < second or (first == second and np.isfinite(first))


def _find_passing_frame(log: Float, simulated: Float, point: tuple[float, float]) -> float:
    """Return the frame in which a vehicle passes the point on its path of the log; infinite if it never does."""
    path = build_polyline(log[np.isfinite(log[:, 0])])
    goal = path.project(*point)[0]
    before = -np.inf
    for frame in np.flatnonzero(np.isfinite(simulated[:, 0])).tolist():
        s = path.project(float(simulated[frame, 0]), float(simulated[frame, 1]))[0]
        if s >= goal - 1e-6:
            return frame - ((s - goal) / (s - before) if s > before > -np.inf else 0.0)
        before = s
    return float("inf")
