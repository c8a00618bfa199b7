"""Plane geometry: angles, oriented boxes and polylines.

Frames: metres, x to the right, y up, radians counter-clockwise from +x. A pose is the centre of a box.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.portable import Operand

Float = npt.NDArray[np.float64]
Bool = npt.NDArray[np.bool_]
Int = npt.NDArray[np.int64]

TAU = 2 * math.pi


@twin
def wrap_angle(angle: float, /) -> float:
    """Return the angle [rad] wrapped to (-pi, pi]."""
    wrapped = math.remainder(angle, TAU)
    return math.pi if wrapped == -math.pi else wrapped


@twin
def wrap_angles(angles: Float, /) -> Float:
    """Return the angles [rad], any shape, wrapped to [-pi, pi)."""
    return np.asarray((angles + math.pi) % TAU - math.pi)


@twin
def box_corners(x: float, y: float, yaw: float, length: float, width: float, /) -> Float:
    """Return the corners (4, 2) of an oriented box, counter-clockwise from front left."""
    cos, sin = portable.cos_sin(yaw)
    return _list_corners(x, y, cos, sin, length, width)


@twin
def boxes_corners(x: Float, y: Float, yaw: Float, length: Float, width: Float, /) -> Float:
    """Return the corners (..., 4, 2) of oriented boxes with parameters that broadcast to (...), as `box_corners`."""
    cos, sin = portable.cos_sin(yaw)
    return _list_corners(*np.broadcast_arrays(x, y, cos, sin, length, width))


def _list_corners(x: Operand, y: Operand, cos: Operand, sin: Operand, length: Operand, width: Operand) -> Float:
    ahead_x, ahead_y = cos * length / 2, sin * length / 2
    left_x, left_y = -sin * width / 2, cos * width / 2
    along_x = x + ahead_x + left_x, x - ahead_x + left_x, x - ahead_x - left_x, x + ahead_x - left_x
    along_y = y + ahead_y + left_y, y - ahead_y + left_y, y - ahead_y - left_y, y + ahead_y - left_y
    return np.stack((np.stack(along_x, axis=-1), np.stack(along_y, axis=-1)), axis=-1)


@twin
def boxes_overlap(first: Float, second: Float, /) -> Bool:
    """Return whether boxes, corners (..., 4, 2) each, overlap (separating-axis test); touching does not count."""
    one, other = (_overlap_along_sides(corners, first, second) for corners in (first, second))
    return np.asarray(one & other)


def _overlap_along_sides(corners: Float, first: Float, second: Float) -> Bool:
    """Return whether the boxes overlap when projected on two neighbouring sides of `corners`."""
    axes = (corners[..., 1:3, :] - corners[..., 0:2, :])[..., None, :]
    a, b = (portable.dot(box[..., None, :, :], axes) for box in (first, second))
    return ((a.max(axis=-1) > b.min(axis=-1)) & (b.max(axis=-1) > a.min(axis=-1))).all(axis=-1)


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
        """Rows (N-1, 6) [m]: arc length, x and y where a segment begins, its extents along x and y, its length."""
        extents = np.diff(self.xy, axis=0)
        lengths = portable.hypot(extents[:, 0], extents[:, 1])
        begins = np.concatenate(((0.0,), np.cumsum(lengths[:-1])))
        return np.column_stack((begins, self.xy[:-1], extents, lengths))

    @cached_property
    def s(self) -> Float:
        """Arc length (N,) [m] at every point."""
        return np.concatenate(((0.0,), np.cumsum(self.lengths)))

    @property
    def lengths(self) -> Float:
        """Length (N-1,) [m] of every segment."""
        return self._segments[:, 5]

    @property
    def length(self) -> float:
        """Total arc length [m]."""
        return float(self.s[-1])

    @cached_property
    def yaws(self) -> Float:
        """Direction (N-1,) [rad] of every segment."""
        return portable.atan2(self._segments[:, 4], self._segments[:, 3])

    def at(self, s: float) -> tuple[float, float]:
        """Return the point [m] at arc length s; outside [0, length] the end segments are extended."""
        return _compute_point(self._segments, s)

    def yaw_at(self, s: float) -> float:
        """Return the direction [rad] of the segment at arc length s."""
        return float(self.yaws[_find_segment(self._segments, s)])

    def yaws_at(self, s: Float) -> Float:
        """Return the directions (M,) [rad] of the segments at arc lengths s (M,)."""
        return self.yaws[np.clip(np.searchsorted(self.s, s, side="right") - 1, 0, len(self.yaws) - 1)]

    def project(self, x: float, y: float, between: tuple[float, float] | None = None) -> tuple[float, float]:
        """Return the Frenet coordinates (s, d) [m] of the nearest point; d > 0 lies to the left.

        `between` limits the search to that range of arc length, for a path that crosses itself.
        """
        low, high = (-math.inf, math.inf) if between is None else between
        return _project_on_segments(self._segments, x, y, low, high)

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


@twin
def _find_segment(segments: Float, s: float, /) -> int:
    """Return the row of `Polyline._segments` at arc length s, the first or last one outside."""
    return max(int(np.searchsorted(segments[:, 0], s, side="right")) - 1, 0)


@twin
def _compute_point(segments: Float, s: float, /) -> tuple[float, float]:
    """See `Polyline.at`."""
    begin, x, y, dx, dy, length = segments[_find_segment(segments, s)].tolist()
    length = max(length, 1e-12)
    return x + (s - begin) * (dx / length), y + (s - begin) * (dy / length)


@twin
def _project_on_segments(segments: Float, x: float, y: float, low: float, high: float, /) -> tuple[float, float]:
    """See `Polyline.project`, between the arc lengths `low` and `high`."""
    least, nearest = math.inf, (math.nan, math.nan)
    for begin, x0, y0, dx, dy, length in segments[
        _find_segment(segments, low) : _find_segment(segments, high) + 1
    ].tolist():
        ahead, left = x - x0, y - y0
        share = (ahead * dx + left * dy) / max(length * length, 1e-18)
        share = min(max(share, 0.0), 1.0)
        gap_x, gap_y = ahead - share * dx, left - share * dy
        square = gap_x * gap_x + gap_y * gap_y
        if square < least:
            distance = math.copysign(math.sqrt(square), dx * left - dy * ahead)
            least, nearest = square, (begin + share * length, distance)
    return nearest
