"""Many polylines at once: feet of points and directions without a loop over the lines."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, Int, Polyline, wrap_angles


@dataclass(frozen=True)
class PolylineProjections:
    """Pairs (P,) of a point and a line near it, ordered by point, then line."""

    point: Int
    line: Int
    s: Float
    """Arc length [m] of the nearest place on the line."""
    ahead: Float
    """Distance [m] from the point to that place along the line: 0 except beyond the line's ends."""
    left: Float
    """Distance [m] from the point to that place across the line, positive if the line lies to the left of the point."""
    yaw: Float
    """Direction [rad] of the line there."""

    @property
    def distance(self) -> Float:
        """[m]"""
        return np.hypot(self.ahead, self.left)


@dataclass(frozen=True, eq=False)
class PolylineIndex:
    """Polylines with a spatial index."""

    lines: Sequence[Polyline]

    @cached_property
    def shapes(self) -> Any:
        """For shapely: an array of objects, also of none."""
        return np.array([shapely.LineString(line.xy) for line in self.lines], dtype=object)

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Spatial index."""
        return shapely.STRtree(self.shapes)

    @cached_property
    def _segments(self) -> tuple[Float, Float, Float]:
        """Arc lengths of all segments' beginnings on one axis, directions, and where each line begins on that axis."""
        lengths = np.array([line.length for line in self.lines])
        base = np.concatenate(((0.0,), np.cumsum(lengths + 1.0)))[:-1]
        begins = [line.s[:-1] + start for line, start in zip(self.lines, base, strict=True)]
        return np.concatenate(begins), np.concatenate([line.yaws for line in self.lines]), base

    def yaws(self, line: Int, s: Float) -> Float:
        """Directions (P,) [rad] of lines (P,) at arc lengths s (P,) [m]."""
        if not len(line):
            return np.zeros(0)
        begins, yaws, base = self._segments
        at = np.clip(s, 0.0, None) + base[line]
        return yaws[np.maximum(np.searchsorted(begins, at, side="right") - 1, 0)]

    def feet(self, xy: Float, reach: float) -> PolylineProjections:
        """Lines within `reach` [m] of the points xy (N, 2) [m]."""
        points: Any = shapely.points(xy)
        point, line = self.tree.query(points, predicate="dwithin", distance=reach)
        order = np.lexsort((line, point))
        point, line = point[order].astype(np.int64), line[order].astype(np.int64)
        s = shapely.line_locate_point(self.shapes[line], points[point])
        gap = shapely.get_coordinates(shapely.line_interpolate_point(self.shapes[line], s)).reshape(-1, 2) - xy[point]
        yaw = self.yaws(line, s)
        cos, sin = np.cos(yaw), np.sin(yaw)
        return PolylineProjections(
            point, line, s, gap[:, 0] * cos + gap[:, 1] * sin, gap[:, 1] * cos - gap[:, 0] * sin, yaw
        )


@dataclass(frozen=True)
class PolylineSamples:
    """Points xy (M, 2) [m] every so many metres on lines, with direction [rad], arc length [m] and line (M,)."""

    xy: Float
    yaw: Float
    s: Float
    line: Int


def sample_polylines(lines: Sequence[Polyline], spacing: float) -> PolylineSamples:
    """Points about every `spacing` [m] of all lines."""
    stations = [line.stations(spacing) for line in lines]
    xy = [
        np.column_stack([np.interp(s, line.s, line.xy[:, axis]) for axis in (0, 1)])
        for line, s in zip(lines, stations, strict=True)
    ]
    yaw = [line.yaws_at(s) for line, s in zip(lines, stations, strict=True)]
    owner = np.repeat(np.arange(len(lines)), [len(s) for s in stations])
    return PolylineSamples(np.concatenate(xy), np.concatenate(yaw), np.concatenate(stations), owner)


def compute_angles_between(a: Float, b: Float) -> Float:
    """Angles [rad] in [0, pi] between directions, any shape."""
    return np.abs(wrap_angles(a - b))
