"""The nearest of many centre lines."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, Int, Polyline


@dataclass(frozen=True, slots=True)
class LineSegments:
    """The K segments of L lines, one line after the other."""

    rows: Float
    """(K, 6) [m]: arc length where it begins, x and y there, x and y where it ends, its length."""
    yaw: Float
    """(K,) direction [rad]."""
    first: Int
    """(L + 1,) row of the first segment of each line, and K."""


def build_line_segments(lines: Sequence[Polyline]) -> LineSegments:
    """Return the segments of one line or more."""
    parts = [np.column_stack((line.s[:-1], line.xy[:-1], line.xy[1:], line.lengths)) for line in lines]
    counts = [len(part) for part in parts]
    first = np.concatenate(((0,), np.cumsum(counts))).astype(np.int64)
    return LineSegments(np.concatenate(parts), np.concatenate([line.yaws for line in lines]), first)


@twin
def find_nearest_lines(rows: Float, first: Int, xy: Float, /) -> tuple[Int, Float, Int]:
    """Return the nearest line, the distance [m] and the segment there (M,) of points xy (M, 2), as `LineSegments`.

    Of equally near lines the first; where two segments meet, the second. Raises ValueError if a point is not finite or
    there is no line.
    """
    if not np.isfinite(xy).all():
        raise ValueError("expected finite points")
    begin, x0, y0, x1, y1, length = rows.T
    dx, dy = x1 - x0, y1 - y0
    square = np.maximum(dx * dx + dy * dy, 1e-300)
    found: list[tuple[int, float, int]] = []
    for x, y in xy.tolist():
        share = ((x - x0) * dx + (y - y0) * dy) / square
        distance = np.abs((y0 - y) * dx - (x0 - x) * dy) / square * np.sqrt(square)
        distance = np.where(share >= 1.0, portable.hypot(x - x1, y - y1), distance)
        distance = np.where(share <= 0.0, portable.hypot(x - x0, y - y0), distance)
        row = int(np.argmin(distance))
        line = int(np.searchsorted(first, row, side="right")) - 1
        station = begin[row] + min(max(share[row], 0.0), 1.0) * length[row]
        behind = np.searchsorted(begin[first[line] : first[line + 1]], station, side="right")
        found.append((line, float(distance[row]), int(first[line] + behind) - 1))
    line, distance, row = zip(*found, strict=True) if found else ((), (), ())
    return np.array(line, dtype=np.int64), np.array(distance, dtype=np.float64), np.array(row, dtype=np.int64)
