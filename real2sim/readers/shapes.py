"""Check arrays and points of untrusted logs, and build lines from them."""

from typing import Any

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from real2sim.recording import RecordedTrack


def parse_numbers(where: str, raw: Any) -> Float:
    """Return an array of any shape; raise InputError if it does not consist of numbers."""
    try:
        return np.asarray(raw, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{where}: expected numbers, found {describe_value(raw)}") from None


def describe_value(raw: Any) -> str:
    """Describe any value for an error message."""
    if isinstance(raw, np.ndarray):
        return f"an array of {raw.dtype.name} of shape {raw.shape}"
    return " ".join(repr(raw)[:60].split())


def parse_all_points(where: str, raw: Any) -> Float:
    """Return the first two columns (N, 2) [m] of a list of points, N >= 1; raise InputError."""
    xy = parse_numbers(where, raw)
    if xy.ndim != 2 or xy.shape[1] < 2 or not len(xy):
        raise InputError(f"{where}: expected points with x and y, found {describe_value(raw)}")
    xy = xy[:, :2]
    finite = np.isfinite(xy).all(1)
    if not finite.all():
        raise InputError(f"{where}: expected finite coordinates, found {xy[~finite][0].tolist()}")
    return xy


def parse_points(where: str, raw: Any) -> Float:
    """Like `parse_all_points`, without consecutive duplicates (closer than 1 mm); raise InputError."""
    xy = parse_all_points(where, raw)
    return xy[np.concatenate(((True,), np.hypot(*np.diff(xy, axis=0).T) > 1e-3))]


def compute_centreline(left: Float, right: Float, spacing: float = 2.0) -> Float:
    """Return the line (N, 2) half-way between two boundaries of one direction, points about `spacing` [m] apart."""
    sides = build_polyline(left), build_polyline(right)
    count = max(2, len(left), len(right), round(max(side.length for side in sides) / spacing) + 1)
    share = np.linspace(0.0, 1.0, count)
    return sum((_sample_line(side, share) for side in sides), np.zeros((count, 2))) / 2


def _sample_line(line: Polyline, share: Float) -> Float:
    return np.column_stack([np.interp(share * line.length, line.s, line.xy[:, axis]) for axis in (0, 1)])


def build_cross_line(centre: Float, x: float, y: float, width: float) -> Float:
    """Return a line (2, 2) [m] across a lane through (x, y), from left to right."""
    line = Polyline(centre)
    s = min(max(line.project(x, y)[0], 0.0), line.length)
    yaw, middle = line.yaw_at(s), np.array(line.at(s))
    left = np.array((-np.sin(yaw), np.cos(yaw))) * width / 2
    return np.stack((middle + left, middle - left))


def shift_ahead(track: RecordedTrack, distance: float) -> RecordedTrack:
    """Shift every pose of a track `distance` [m] ahead, e.g. from the rear axle to the box centre."""
    return track.replace_columns(x=track.x + distance * np.cos(track.yaw), y=track.y + distance * np.sin(track.yaw))
