"""Vectorised queries over many polylines: projections, directions and samples."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Bool, Float, Int, Polyline, wrap_angles
from real2sim.segment_tree import SegmentTree, find_first


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
    def _pieces(self) -> SegmentTree:
        """The segments (S,) of all polylines."""
        return SegmentTree.from_lines([line.xy for line in self.polylines])

    @cached_property
    def _stations(self) -> tuple[Float, Float, Bool]:
        """Arc lengths (S,) [m] where the segments begin and end on their polylines, and whether these end there."""
        lasts = np.cumsum([len(line.xy) - 1 for line in self.polylines], dtype=np.int64)
        ends = np.concatenate(list(map(np.cumsum, np.split(np.sqrt(self._pieces.squared), lasts[:-1]))))
        begins = np.concatenate((np.zeros(1), ends))[: len(ends)]
        begins[lasts[:-1]] = 0.0
        is_last = np.zeros(len(ends), dtype=np.bool_)
        is_last[lasts - 1] = True
        return begins, ends, is_last

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

    def locate_points(self, xy: Float, reach: float) -> tuple[Int, Int, Float, Float]:
        """Return point, polyline, arc length (P,) [m] and position (P, 2) [m] of the projections within `reach` [m].

        The bits are those of GEOS (`dwithin`, `line_locate_point`, `line_interpolate_point`), without its walk along
        the whole polyline for each point.
        """
        point, piece, s = self._find_nearest_pieces(xy, reach)
        return point, self._pieces.line[piece], s, self._interpolate_points(piece, s)

    def project_points(self, xy: Float, reach: float) -> PolylineProjections:
        """Project points xy (N, 2) [m] onto all polylines within `reach` [m]."""
        point, line, s, foot = self.locate_points(xy, reach)
        gap = foot - xy[point]
        yaw = self.compute_yaws(line, s)
        cos, sin = np.cos(yaw), np.sin(yaw)
        return PolylineProjections(
            point, line, s, gap[:, 0] * cos + gap[:, 1] * sin, gap[:, 1] * cos - gap[:, 0] * sin, yaw
        )

    def _find_nearest_pieces(self, xy: Float, reach: float) -> tuple[Int, Int, Float]:
        """Return point and nearest segment (P,) of every polyline within `reach` [m] of a point, and the arc length [m]
        of its projection; of segments equally near the first.
        """
        point, piece, distance, share = self._pieces.find_near(xy, reach)
        order = np.argsort(point * len(self._pieces.line) + piece)
        point, piece, distance, share = point[order], piece[order], distance[order], share[order]
        begins = np.flatnonzero(find_first(point, self._pieces.line[piece]))
        pair = np.cumsum(np.bincount(begins, minlength=len(point))) - 1
        least = np.flatnonzero(distance == np.minimum.reduceat(distance, begins)[pair]) if len(begins) else begins
        least = least[find_first(pair[least])]
        point, piece, share = point[least], piece[least], share[least]
        length = np.sqrt(self._pieces.squared[piece])
        passed = np.where(share <= 0.0, 0.0, np.where(share <= 1.0, share * length, length))
        return point, piece, self._stations[0][piece] + passed

    def _interpolate_points(self, piece: Int, s: Float) -> Float:
        """Return the points (P, 2) [m] at arc length s [m] of the polylines, on these segments or where they end."""
        pieces, (begins, ends, is_last) = self._pieces, self._stations
        piece = piece.copy()
        while len(ahead := np.flatnonzero((ends[piece] <= s) & ~is_last[piece])):
            piece[ahead] += 1
        length = np.sqrt(pieces.squared[piece])
        share = ((s - begins[piece]) / np.where(length > 0.0, length, 1.0))[:, None]
        is_end = (share >= 1.0) | (ends[piece] <= s)[:, None]
        between = np.where(share <= 0.0, pieces.begin[piece], pieces.vector[piece] * share + pieces.begin[piece])
        return np.where(is_end, pieces.end[piece], between)


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
