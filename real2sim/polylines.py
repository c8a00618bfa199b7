"""Vectorised queries over many polylines: projections, directions and samples."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, Int, Polyline, wrap_angles


@dataclass(frozen=True)
class PolylineProjections:
    """Pairs (P,) of a point and a polyline near it, ordered by point, then polyline."""

    point: Int
    line: Int
    s: Float
    """Arc length [m] of the nearest point of the polyline."""
    longitudinal: Float
    """Longitudinal distance [m] from the point to its projection: 0 except beyond the ends of the polyline."""
    lateral: Float
    """Lateral distance [m] from the point to its projection, positive if the polyline lies to the left of the point."""
    yaw: Float
    """Direction [rad] of the polyline at the projection."""

    @property
    def distance(self) -> Float:
        """Euclidean distance [m]."""
        return np.hypot(self.longitudinal, self.lateral)


@dataclass(frozen=True, eq=False)
class PolylineIndex:
    """Polylines with a spatial index."""

    polylines: Sequence[Polyline]

    @cached_property
    def geometries(self) -> Any:
        """Line strings as an object array, which may be empty."""
        return np.array([shapely.LineString(line.xy) for line in self.polylines], dtype=object)

    @cached_property
    def tree(self) -> shapely.STRtree:
        """Spatial index."""
        return shapely.STRtree(self.geometries)

    @cached_property
    def _segments(self) -> tuple[Float, Float, Float]:
        """Arc lengths of all segment starts on one common axis, their directions, and the offset of each polyline on
        it.
        """
        lengths = np.array([line.length for line in self.polylines])
        base = np.concatenate(((0.0,), np.cumsum(lengths + 1.0)))[:-1]
        begins = [line.s[:-1] + start for line, start in zip(self.polylines, base, strict=True)]
        return np.concatenate(begins), np.concatenate([line.yaws for line in self.polylines]), base

    def compute_yaws(self, line: Int, s: Float) -> Float:
        """Return directions (P,) [rad] of polylines (P,) at arc lengths s (P,) [m]."""
        if not len(line):
            return np.zeros(0)
        begins, yaws, base = self._segments
        stations = np.clip(s, 0.0, None) + base[line]
        return yaws[np.maximum(np.searchsorted(begins, stations, side="right") - 1, 0)]

    def project_points(self, xy: Float, reach: float) -> PolylineProjections:
        """Project points xy (N, 2) [m] onto all polylines within `reach` [m]."""
        points: Any = shapely.points(xy)
        point, line = self.tree.query(points, predicate="dwithin", distance=reach)
        order = np.lexsort((line, point))
        point, line = point[order].astype(np.int64), line[order].astype(np.int64)
        s = shapely.line_locate_point(self.geometries[line], points[point])
        gap = (
            shapely.get_coordinates(shapely.line_interpolate_point(self.geometries[line], s)).reshape(-1, 2) - xy[point]
        )
        yaw = self.compute_yaws(line, s)
        cos, sin = np.cos(yaw), np.sin(yaw)
        return PolylineProjections(
            point, line, s, gap[:, 0] * cos + gap[:, 1] * sin, gap[:, 1] * cos - gap[:, 0] * sin, yaw
        )


@dataclass(frozen=True)
class PolylineSamples:
    """Equidistant points xy (M, 2) [m] on polylines, with direction [rad], arc length [m] and polyline (M,)."""

    xy: Float
    yaw: Float
    s: Float
    line: Int


def sample_polylines(lines: Sequence[Polyline], spacing: float) -> PolylineSamples:
    """Sample all polylines at a spacing of about `spacing` [m]."""
    stations = [line.stations(spacing) for line in lines]
    xy = [
        np.column_stack([np.interp(s, line.s, line.xy[:, axis]) for axis in (0, 1)])
        for line, s in zip(lines, stations, strict=True)
    ]
    yaw = [line.yaws_at(s) for line, s in zip(lines, stations, strict=True)]
    owner = np.repeat(np.arange(len(lines)), [len(s) for s in stations])
    return PolylineSamples(np.concatenate(xy), np.concatenate(yaw), np.concatenate(stations), owner)


def compute_angles_between(a: Float, b: Float) -> Float:
    """Return the angles [rad] in [0, pi] between directions of any shape."""
    return np.abs(wrap_angles(a - b))
