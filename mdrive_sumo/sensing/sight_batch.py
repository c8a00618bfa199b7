"""SightBatch: the lines of sight of several eyes on one scene. `visibility` explains the geometry.

An eye's arrays have a dozen rows, so that the number of array operations is what they cost: those of all eyes of a tick
together take about as long as those of one. Each eye's numbers are the same, to the last bit, in any company.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU, Bool, Float, Int
from mdrive_sumo.sensing.building_edges import BuildingEdges, Rows
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose

TIE = 1e-9
"""Edges whose 1/distance differs by less [1/m] are equally near: 0.01 mm at 100 m. Touching boxes do not flicker."""
FLAT = 1e-9
"""The eye lies on an edge's line, and does not see it, below this value of twice their triangle [m2]."""


class SightEdges(NamedTuple):
    """The E edges that face an eye, as it sees them: from right to left, counter-clockwise. Those of boxes first."""

    right: Float
    """(E,) angle of one end [rad] in [-pi, pi]."""
    left: Float
    """(E,) of the other end; less than `right` if the edge lies across the direction -x."""
    cos: Float
    """(E,) with `sin`: 1/distance of the edge [1/m] towards angle a is cos * cos(a) + sin * sin(a)."""
    sin: Float
    eye: Int
    """(E,) index of the eye."""
    owner: Int
    """(B,) row of the box of each of the first B edges; the others are walls."""
    hides: Bool
    """(E,) whether it hides what lies behind."""
    extent: Float
    """(E,) angular width [rad]."""


class _Cuts(NamedTuple):
    """The ends of all edges of each eye: C intervals, counter-clockwise, those of an eye together."""

    angle: Float
    """(C,) where the interval begins [rad]."""
    width: Float
    """(C,) [rad]"""
    following: Rows
    """(C,) index of the next interval around the eye."""
    first: Rows
    """(E,) interval with which each edge begins."""
    after: Rows
    """(E,) interval before which it ends."""
    base: Rows
    """(E,) first interval of the edge's eye."""
    around: Rows
    """(E,) number of intervals of the edge's eye."""


def _cut_circles(edges: SightEdges, eyes: int) -> _Cuts:
    """Cut the circle around each eye at the ends of all its edges."""
    ends = np.empty((2, len(edges.eye)), dtype=np.complex128)
    ends.real, ends.imag = edges.eye, (edges.right, edges.left)
    places = np.sort(ends.ravel(), kind="stable")  # by eye, then by angle: complex numbers are sorted so
    first, after = places.searchsorted(ends)
    counts = 2 * np.bincount(edges.eye, minlength=eyes)
    bases = np.cumsum(counts) - counts
    following = np.arange(1, len(places) + 1)
    last = (bases + counts)[counts > 0] - 1
    following[last] = bases[counts > 0]
    angle = places.imag.copy()
    beyond = angle[following]
    beyond[last] += TAU
    return _Cuts(angle, beyond - angle, following, first, after, bases[edges.eye], counts[edges.eye])


class _Pieces(NamedTuple):
    """Edges cut at the ends of all edges: P pieces, each of one edge in one of the intervals."""

    edge: Rows
    """(P,) index of the edge."""
    interval: Rows
    """(P,) index of the interval."""
    intervals: int
    """Number of intervals."""


def _cut_edges(cuts: _Cuts) -> _Pieces:
    """Each edge is in the intervals first ... after - 1, counted around the circle of its eye."""
    counts = np.where(cuts.after < cuts.first, cuts.after + cuts.around, cuts.after) - cuts.first
    edge = np.repeat(np.arange(len(counts)), counts)
    begins = np.cumsum(counts) - counts
    interval = np.arange(len(edge)) + (cuts.first - begins)[edge]
    around = cuts.around[edge]
    interval = np.where(interval >= cuts.base[edge] + around, interval - around, interval)
    return _Pieces(edge, interval, len(cuts.angle))


def _compare_with_nearest(
    pieces: _Pieces, hides: Bool, begin: Float, end: Float, of_box: slice
) -> tuple[Bool, npt.NDArray[np.intp]]:
    """Return which pieces of boxes nothing hides, as a mask, and the indices of those that are hidden in part.

    begin, end: (P,) 1/distance of the pieces where their interval begins and ends. hides: (P,).
    """
    opaque = np.flatnonzero(hides)
    places, begins, ends = pieces.interval[opaque], begin[opaque], end[opaque]
    middles = begins + ends
    nearest = np.zeros((3, pieces.intervals))
    for row, near in zip(nearest, (begins, ends, middles), strict=True):
        np.maximum.at(row, places, near)
    interval, begin, end = pieces.interval[of_box], begin[of_box], end[of_box]
    in_sight = nearest[:2] - TIE
    clear = (begin >= in_sight[0].take(interval)) & (end >= in_sight[1].take(interval))
    behind = np.flatnonzero(~clear)
    if not len(behind):
        return clear, behind
    first = np.flatnonzero(middles >= nearest[2].take(places))
    is_first = np.zeros(len(hides), dtype=np.bool_)
    is_first[opaque[first]] = True
    front = np.zeros((2, pieces.intervals))
    front[:, places[first]] = begins[first], ends[first]
    interval = interval[behind]
    hidden = (front[0, interval] >= begin[behind] - TIE) & (front[1, interval] >= end[behind] - TIE) & ~is_first[behind]
    return clear, behind[~hidden]


class SightBatch:
    """Visibility from V sensor poses, each within its range [m]."""

    def __init__(self, scene: SensingFrame, buildings: BuildingEdges, eyes: Sequence[tuple[SensorPose, float]]) -> None:
        """eyes: poses and ranges."""
        self._scene = scene
        x, y, range_m = np.array([(eye.x, eye.y, range_m) for eye, range_m in eyes]).T
        self.distances: Float = _compute_distances(scene, x, y)
        """(V, N) distance from an eye to the nearest point of each box [m]; infinite for the carrier's own."""
        for row, (eye, _) in enumerate(eyes):
            if eye.carrier_row is not None:
                self.distances[row, eye.carrier_row] = np.inf
        self._is_near = self.distances <= range_m[:, None]
        self.edges: SightEdges = self._find_edges(buildings, x, y, range_m)

    def _find_edges(self, buildings: BuildingEdges, x: Float, y: Float, range_m: Float) -> SightEdges:
        # What lies wholly out of range is left out: it can hide only what is out of range too.
        scene, (eye_of_box, rows) = self._scene, self._is_near.nonzero()
        eye_of_wall, walls = buildings.find_near(x, y, range_m)
        edges = np.concatenate(
            (scene.edges.take(rows, axis=1).reshape(4, -1), buildings.walls.take(walls, axis=1)), axis=1
        )
        eye = np.concatenate((eye_of_box.repeat(4), eye_of_wall))
        edges[:2] -= x[eye]
        edges[2:] -= y[eye]
        double_area = edges[0] * edges[3] - edges[2] * edges[1]
        facing = np.flatnonzero(double_area < -FLAT)
        (px, qx, py, qy), double_area = (edges := edges.take(facing, axis=1)), double_area.take(facing)
        left, right = portable.atan2(edges[2:], edges[:2])
        owner = rows.repeat(4).take(facing[: np.searchsorted(facing, 4 * len(rows))])
        hides = np.ones(len(facing), dtype=np.bool_)  # as walls do
        hides[: len(owner)] = scene.opaque[owner]
        cos, sin = (qy - py) / double_area, -((qx - px) / double_area)
        return SightEdges(right, left, cos, sin, eye.take(facing), owner, hides, (left - right) % TAU)

    def select_edges(self, row: int) -> SightEdges:
        """Return the edges of one eye."""
        right, left, cos, sin, eye, owner, hides, extent = self.edges
        mine = np.flatnonzero(eye == row)
        owner = owner[mine[: mine.searchsorted(len(owner))]]
        return SightEdges(right[mine], left[mine], cos[mine], sin[mine], eye[mine], owner, hides[mine], extent[mine])

    @cached_property
    def visible_fractions(self) -> Float:
        """(V, N) visible share in [0, 1] of each box's angular width; 0 for the carrier and out of range."""
        owner, shape = self.edges.owner, self.distances.shape
        cell = self.edges.eye[: len(owner)] * shape[1] + owner
        extent = np.bincount(cell, self.edges.extent[: len(owner)], shape[0] * shape[1]).reshape(shape)
        seen = np.bincount(cell, self._compute_visible_widths(), shape[0] * shape[1]).reshape(shape)
        around = self._is_near & (extent == 0.0)  # no edge faces an eye inside
        return np.where(around, 1.0, np.clip(seen / np.where(extent > 0.0, extent, 1.0), 0.0, 1.0))

    def _compute_visible_widths(self) -> Float:
        """Return the visible angular width (B,) [rad] of each edge of a box."""
        edges = self.edges
        if not len(edges.owner):
            return np.zeros(0)
        cuts = _cut_circles(edges, len(self.distances))
        pieces = _cut_edges(cuts)
        cos, sin = portable.cos_sin(cuts.angle)
        edge, interval, _ = pieces
        after = cuts.following[interval]
        a, b = edges.cos[edge], edges.sin[edge]
        begin = a * cos[interval] + b * sin[interval]
        end = a * cos[after] + b * sin[after]
        of_box = slice(0, edge.searchsorted(len(edges.owner)))
        clear, unclear = _compare_with_nearest(pieces, edges.hides[edge], begin, end, of_box)
        seen = np.where(clear, cuts.width[interval[of_box]], 0.0)
        for i in unclear.tolist():
            sector = interval[i]
            others = edge[(interval == sector) & edges.hides[edge] & (edge != edge[i])]
            seen[i] = self._compute_visible_width(
                int(edge[i]), others, float(cuts.angle[sector]), float(cuts.width[sector])
            )
        return np.bincount(edge[of_box], seen, len(edges.owner)).astype(np.float64, copy=False)

    def _compute_visible_width(self, edge: int, others: Rows, begin: float, width: float) -> float:
        """Return the visible width [rad] of an edge from the angle begin on, where boxes overlap."""
        edges = self.edges
        a, b = edges.cos[others] - edges.cos[edge], edges.sin[others] - edges.sin[edge]
        (cos, sin), (cos_end, sin_end) = portable.cos_sin(begin), portable.cos_sin(begin + width)
        first, last = a * cos + b * sin > 0.0, a * cos_end + b * sin_end > 0.0
        change = np.minimum((portable.atan2(-a, b) - begin) % np.pi, width)
        since = np.where(first, np.where(last, width, change), 0.0).max(initial=0.0)
        until = np.where(last & ~first, change, width).min(initial=width)
        return max(0.0, float(until - since))


def _compute_distances(scene: SensingFrame, x: Float, y: Float) -> Float:
    b, (cos, sin) = scene.boxes, scene.directions
    dx, dy = b.x - x[:, None], b.y - y[:, None]
    ahead = np.maximum(np.abs(cos * dx + sin * dy) - b.length / 2, 0.0)
    aside = np.maximum(np.abs(cos * dy - sin * dx) - b.width / 2, 0.0)
    return portable.hypot(ahead, aside)
