"""Plane geometry: angles, oriented boxes and polylines.

Frames: metres, x to the right, y up, radians counter-clockwise from +x. A pose is the centre of a box.
"""

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable

Float = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]
Int = npt.NDArray[np.int64]

TAU = 2 * math.pi


def wrap_angle(angle: float) -> float:
    """Return the angle [rad] wrapped to (-pi, pi]."""
    wrapped = math.remainder(angle, TAU)
    return math.pi if wrapped == -math.pi else wrapped


def wrap_angles(angles: Float) -> Float:
    """Return the angles [rad], any shape, wrapped to [-pi, pi)."""
    return (angles + math.pi) % TAU - math.pi


def box_corners(x: float, y: float, yaw: float, length: float, width: float) -> Float:
    """Return the corners (4, 2) of an oriented box, counter-clockwise from front left."""
    cos, sin = portable.cos_sin(yaw)
    ahead_x, ahead_y = cos * length / 2, sin * length / 2
    left_x, left_y = -sin * width / 2, cos * width / 2
    return np.array(
        (
            (x + ahead_x + left_x, y + ahead_y + left_y),
            (x - ahead_x + left_x, y - ahead_y + left_y),
            (x - ahead_x - left_x, y - ahead_y - left_y),
            (x + ahead_x - left_x, y + ahead_y - left_y),
        )
    )


def boxes_corners(x: Float, y: Float, yaw: Float, length: Float, width: Float) -> Float:
    """Return the corners (..., 4, 2) of oriented boxes with parameters that broadcast to (...), as `box_corners`."""
    cos, sin = portable.cos_sin(yaw)
    ahead_x, ahead_y = cos * length / 2, sin * length / 2
    left_x, left_y = -sin * width / 2, cos * width / 2
    front_x, front_y, back_x, back_y = x + ahead_x, y + ahead_y, x - ahead_x, y - ahead_y
    corners = np.empty((*np.broadcast_shapes(np.shape(front_x), np.shape(left_x)), 4, 2))
    np.add(front_x, left_x, out=corners[..., 0, 0])
    np.add(front_y, left_y, out=corners[..., 0, 1])
    np.add(back_x, left_x, out=corners[..., 1, 0])
    np.add(back_y, left_y, out=corners[..., 1, 1])
    np.subtract(back_x, left_x, out=corners[..., 2, 0])
    np.subtract(back_y, left_y, out=corners[..., 2, 1])
    np.subtract(front_x, left_x, out=corners[..., 3, 0])
    np.subtract(front_y, left_y, out=corners[..., 3, 1])
    return corners


def boxes_overlap(first: Float, second: Float) -> Bool:
    """Return whether boxes, corners (..., 4, 2) each, overlap (separating-axis test); touching does not count."""
    one, other = (_overlap_along_sides(corners, first, second) for corners in (first, second))
    return one & other


def _overlap_along_sides(corners: Float, first: Float, second: Float) -> Bool:
    """Return whether the boxes overlap when projected on two neighbouring sides of `corners`."""
    axes = (corners[..., 1:3, :] - corners[..., 0:2, :])[..., None, :]
    a_low, a_high = _find_extremes(portable.dot(first[..., None, :, :], axes))
    b_low, b_high = _find_extremes(portable.dot(second[..., None, :, :], axes))
    overlap = (a_high > b_low) & (b_high > a_low)
    return overlap[..., 0] & overlap[..., 1]


def _find_extremes(values: Float) -> tuple[Float, Float]:
    """Return the least and the greatest (...,) of four values (..., 4); NumPy's reductions take far longer for four."""
    a, b, c, d = values[..., 0], values[..., 1], values[..., 2], values[..., 3]
    return np.minimum(np.minimum(a, b), np.minimum(c, d)), np.maximum(np.maximum(a, b), np.maximum(c, d))


@dataclass(frozen=True)
class Polyline:
    """A chain of distinct points xy (N, 2) [m], N >= 2, measured by its arc length."""

    xy: Float

    def __post_init__(self) -> None:
        if self.xy.ndim != 2 or self.xy.shape[1] != 2 or len(self.xy) < 2:
            raise ValueError(f"a polyline needs an (N, 2) array with N >= 2, got shape {self.xy.shape}")
        if not np.isfinite(self.xy).all():
            raise ValueError("a polyline needs finite coordinates")

    @cached_property
    def _segments(self) -> Float:
        return np.diff(self.xy, axis=0)

    @cached_property
    def _lengths(self) -> Float:
        return portable.hypot(self._segments[:, 0], self._segments[:, 1])

    @cached_property
    def s(self) -> Float:
        """Arc length (N,) [m] at every point."""
        return np.concatenate(((0.0,), np.cumsum(self._lengths)))

    @property
    def length(self) -> float:
        """Total arc length [m]."""
        return float(self.s[-1])

    @cached_property
    def yaws(self) -> Float:
        """Direction (N-1,) [rad] of every segment."""
        return portable.atan2(self._segments[:, 1], self._segments[:, 0])

    @cached_property
    def _plain(self) -> tuple[list[float], list[tuple[float, float]], list[float]]:
        """Arc lengths, unit vectors and directions of the segments as Python floats, for fast single queries."""
        units = self._segments / np.maximum(self._lengths, 1e-12)[:, None]
        return self.s.tolist(), [(x, y) for x, y in units.tolist()], self.yaws.tolist()

    def _segment_at(self, s: float) -> int:
        return min(max(bisect_right(self._plain[0], s) - 1, 0), len(self._lengths) - 1)

    def at(self, s: float) -> tuple[float, float]:
        """Return the point [m] at arc length s; outside [0, length] the end segments are extended."""
        i = self._segment_at(s)
        stations, units, _ = self._plain
        ahead = s - stations[i]
        return float(self.xy[i, 0]) + ahead * units[i][0], float(self.xy[i, 1]) + ahead * units[i][1]

    def yaw_at(self, s: float) -> float:
        """Return the direction [rad] of the segment at arc length s."""
        return self._plain[2][self._segment_at(s)]

    def yaws_at(self, s: Float) -> Float:
        """Return the directions (M,) [rad] of the segments at arc lengths s (M,)."""
        return self.yaws[np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.yaws) - 1)]

    def project(self, x: float, y: float, between: tuple[float, float] | None = None) -> tuple[float, float]:
        """Return the Frenet coordinates (s, d) [m] of the nearest point; d > 0 lies to the left.

        `between` limits the search to that range of arc length, for a path that crosses itself.
        """
        low, high = (0, len(self._lengths))
        if between is not None:
            low, high = self._segment_at(between[0]), self._segment_at(between[1]) + 1
        start, segments, lengths = self.xy[low:high], self._segments[low:high], self._lengths[low:high]
        relative = np.array((x, y)) - start
        square = np.maximum(lengths * lengths, 1e-18)
        share = np.clip((relative * segments).sum(1) / square, 0.0, 1.0)
        gap = relative - share[:, None] * segments
        i = int(np.argmin((gap * gap).sum(1)))
        side = segments[i, 0] * relative[i, 1] - segments[i, 1] * relative[i, 0]
        distance = portable.hypot(gap[i, 0], gap[i, 1])
        return float(self.s[low + i] + share[i] * lengths[i]), math.copysign(distance, side)

    def stations(self, spacing: float) -> Float:
        """Return arc lengths (M,) every `spacing` metres from the start to the end.

        The last step is 0.1 to 1.1 spacings long, so that rounding cannot collapse it.
        """
        whole = np.arange(0.0, self.length, spacing)
        if len(whole) > 1 and self.length - whole[-1] < 0.1 * spacing:
            whole = whole[:-1]
        return np.append(whole, self.length)

    def resample(self, spacing: float) -> "Polyline":
        """Return the polyline through points at the arc lengths of `stations`."""
        stations = self.stations(spacing)
        return Polyline(np.column_stack([np.interp(stations, self.s, self.xy[:, axis]) for axis in (0, 1)]))


def build_polyline(points: Sequence[Sequence[float]] | Float) -> Polyline:
    """Return a polyline through the points without consecutive duplicates (closer than 1 µm)."""
    xy = np.asarray(points, dtype=np.float64)
    steps = portable.hypot(*np.diff(xy, axis=0).T) if len(xy) > 1 else np.zeros(0)
    return Polyline(xy[np.concatenate(((True,), steps > 1e-6))])
