"""Exact line of sight in the plane: visible share of each box past vehicles, static props and buildings.

A ray from the eye meets a box or building first on an edge that faces the eye, so only those edges matter. The angles
of their ends cut the circle into intervals, in each of which the same edges lie side by side; 1/distance of an edge is
A cos + B sin of the direction, so that two edges of an interval change places at most once, at a known angle.
Nothing is sampled. Pedestrians, cyclists and low props (cones, crates) hide nothing. A box or building that contains
the eye (after a collision, or by its mounting) hides nothing, and a box around the eye is fully visible.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU, Bool, Float, Int
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose

TIE = 1e-9
"""Edges whose 1/distance differs by less [1/m] are equally near: 0.01 mm at 100 m. Touching boxes do not flicker."""
FLAT = 1e-9
"""The eye lies on an edge's line, and does not see it, below this value of twice their triangle [m2]."""


class BuildingEdges:
    """The building edges of a map, indexed by building."""

    def __init__(self, roads: RoadMap) -> None:
        """`roads` may have no buildings; their outlines may run either way round."""
        rings = [_counter_clockwise(np.array(building.polygon, dtype=np.float64)) for building in roads.buildings]
        starts = np.concatenate([np.zeros((0, 2)), *rings])
        ends = np.concatenate([np.zeros((0, 2)), *(np.roll(ring, -1, axis=0) for ring in rings)])
        self.walls: Float = np.stack((starts[:, 0], ends[:, 0], starts[:, 1], ends[:, 1]))
        """(4, W) x of their starts and ends, y of their starts and ends [m]."""
        self._middles = np.array([(ring.min(0) + ring.max(0)) / 2 for ring in rings]).reshape(-1, 2)
        self._radii = np.array(
            [portable.hypot(*(ring - middle).T).max() for ring, middle in zip(rings, self._middles, strict=True)]
        )
        self._building = np.repeat(np.arange(len(rings)), [len(ring) for ring in rings])

    def find_near(self, eye: SensorPose, reach_m: float) -> Float:
        """Return the walls (4, V) of all buildings within reach_m."""
        if not len(self._radii):
            return self.walls
        gap = portable.hypot(self._middles[:, 0] - eye.x, self._middles[:, 1] - eye.y) - self._radii
        near = gap <= reach_m
        return self.walls if near.all() else self.walls.compress(near[self._building], axis=1)


def _counter_clockwise(ring: Float) -> Float:
    after = np.roll(ring, -1, axis=0)
    area = (ring[:, 0] * after[:, 1] - after[:, 0] * ring[:, 1]).sum()
    return ring if area > 0 else ring[::-1]


class _Edges(NamedTuple):
    """The E edges that face the eye, as it sees them: from right to left, counter-clockwise. Those of boxes first."""

    right: Float
    """(E,) angle of one end [rad] in [-pi, pi]."""
    left: Float
    """(E,) of the other end; less than `right` if the edge lies across the direction -x."""
    cos: Float
    """(E,) with `sin`: 1/distance of the edge [1/m] towards angle a is cos * cos(a) + sin * sin(a)."""
    sin: Float
    owner: Int
    """(B,) row of the box of each of the first B edges; the others are walls."""
    hides: Bool
    """(E,) whether it hides what lies behind."""
    extent: Float
    """(E,) angular width [rad]."""


class _Pieces(NamedTuple):
    """Edges cut at the ends of all edges: P pieces, each of one edge in one of the intervals."""

    edge: npt.NDArray[np.intp]
    """(P,) index of the edge."""
    interval: npt.NDArray[np.intp]
    """(P,) index of the interval."""
    intervals: int
    """Number of intervals."""


def _cut_edges(first: npt.NDArray[np.intp], after: npt.NDArray[np.intp], intervals: int) -> _Pieces:
    """Each edge is in the intervals first ... after - 1, counted around the circle of so many intervals."""
    counts = np.where(after < first, after + intervals, after) - first
    edge = np.repeat(np.arange(len(counts)), counts)
    begins = np.cumsum(counts) - counts
    interval = np.arange(len(edge)) + (first - begins)[edge]
    return _Pieces(edge, np.where(interval >= intervals, interval - intervals, interval), intervals)


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
    at, begin, end = pieces.interval[of_box], begin[of_box], end[of_box]
    in_sight = nearest[:2] - TIE
    clear = (begin >= in_sight[0].take(at)) & (end >= in_sight[1].take(at))
    behind = np.flatnonzero(~clear)
    if not len(behind):
        return clear, behind
    first = np.flatnonzero(middles >= nearest[2].take(places))
    is_first = np.zeros(len(hides), dtype=np.bool_)
    is_first[opaque[first]] = True
    front = np.zeros((2, pieces.intervals))
    front[:, places[first]] = begins[first], ends[first]
    at = at[behind]
    hidden = (front[0, at] >= begin[behind] - TIE) & (front[1, at] >= end[behind] - TIE) & ~is_first[behind]
    return clear, behind[~hidden]


@dataclass(frozen=True)
class SightView:
    """Visibility from one sensor pose within range_m."""

    eye: SensorPose
    scene: SensingFrame
    buildings: BuildingEdges
    range_m: float

    @cached_property
    def distances(self) -> Float:
        """(N,) distance from the eye to the nearest point of each box [m]; infinite for the carrier's own."""
        b, (cos, sin) = self.scene.boxes, self.scene.directions
        x, y = b.x - self.eye.x, b.y - self.eye.y
        ahead = np.maximum(np.abs(cos * x + sin * y) - b.length / 2, 0.0)
        aside = np.maximum(np.abs(cos * y - sin * x) - b.width / 2, 0.0)
        gaps = portable.hypot(ahead, aside)
        if self.eye.carrier_row is not None:
            gaps[self.eye.carrier_row] = np.inf
        return gaps

    @cached_property
    def _edges(self) -> _Edges:
        eye, rows = self.eye, np.flatnonzero(self.distances <= self.range_m)
        # What lies wholly out of range is left out: it can hide only what is out of range too.
        walls = self.buildings.find_near(eye, self.range_m)
        edges = np.concatenate((self.scene.edges[:, rows].reshape(4, -1), walls), axis=1)
        edges -= np.array(((eye.x,), (eye.x,), (eye.y,), (eye.y,)))
        double_area = edges[0] * edges[3] - edges[2] * edges[1]
        facing = np.flatnonzero(double_area < -FLAT)
        (px, qx, py, qy), double_area = (edges := edges.take(facing, axis=1)), double_area.take(facing)
        left, right = portable.atan2(edges[2:], edges[:2])
        owner = rows.repeat(4).take(facing[: np.searchsorted(facing, 4 * len(rows))])
        hides = np.ones(len(facing), dtype=np.bool_)  # as walls do
        hides[: len(owner)] = self.scene.opaque[owner]
        cos, sin = (qy - py) / double_area, -((qx - px) / double_area)
        return _Edges(right, left, cos, sin, owner, hides, (left - right) % TAU)

    def visible_fractions(self) -> Float:
        """Return the visible share (N,) in [0, 1] of each box's angular width; 0 for the carrier and out of range."""
        owner, count = self._edges.owner, len(self.distances)
        extent = np.bincount(owner, self._edges.extent[: len(owner)], count)
        seen = np.bincount(owner, self._compute_visible_widths(), count)
        around = (self.distances <= self.range_m) & (extent == 0.0)  # no edge faces an eye inside
        return np.where(around, 1.0, np.clip(seen / np.where(extent > 0.0, extent, 1.0), 0.0, 1.0))

    def _compute_visible_widths(self) -> Float:
        """Return the visible angular width (B,) [rad] of each edge of a box."""
        edges = self._edges
        if not len(edges.owner):
            return np.zeros(0)
        cuts = np.sort(np.concatenate((edges.right, edges.left)), kind="stable")
        pieces = _cut_edges(cuts.searchsorted(edges.right), cuts.searchsorted(edges.left), len(cuts))
        cos, sin = portable.cos_sin(np.append(cuts, cuts[0]))
        edge, interval, _ = pieces
        a, b = edges.cos[edge], edges.sin[edge]
        begin = a * cos[interval] + b * sin[interval]
        end = a * cos[interval + 1] + b * sin[interval + 1]
        of_box = slice(0, edge.searchsorted(len(edges.owner)))
        widths = np.append(cuts[1:], cuts[0] + TAU) - cuts
        clear, unclear = _compare_with_nearest(pieces, edges.hides[edge], begin, end, of_box)
        seen = np.where(clear, widths[interval[of_box]], 0.0)
        for i in unclear.tolist():
            others = edge[(interval == interval[i]) & edges.hides[edge] & (edge != edge[i])]
            seen[i] = self._compute_visible_width(
                int(edge[i]), others, float(cuts[interval[i]]), float(widths[interval[i]])
            )
        return np.bincount(edge[of_box], seen, len(edges.owner)).astype(np.float64, copy=False)

    def _compute_visible_width(self, edge: int, others: npt.NDArray[np.intp], begin: float, width: float) -> float:
        """Return the visible width [rad] of an edge from the angle begin on, where boxes overlap."""
        edges = self._edges
        a, b = edges.cos[others] - edges.cos[edge], edges.sin[others] - edges.sin[edge]
        (cos, sin), (cos_end, sin_end) = portable.cos_sin(begin), portable.cos_sin(begin + width)
        first, last = a * cos + b * sin > 0.0, a * cos_end + b * sin_end > 0.0
        change = np.minimum((portable.atan2(-a, b) - begin) % np.pi, width)
        since = np.where(first, np.where(last, width, change), 0.0).max(initial=0.0)
        until = np.where(last & ~first, change, width).min(initial=width)
        return max(0.0, float(until - since))

    def free_sight(self, sectors: int) -> Float:
        """Return the distance (sectors,) [m] to the first building, vehicle or high static box, at most range_m.

        Each value belongs to the ray at the beginning of its equal sector, counter-clockwise from the eye's yaw.
        """
        edges, step = self._edges, TAU / sectors
        turned = ((edges.right - self.eye.yaw) % TAU) / step
        first = np.ceil(turned)
        after = np.floor(turned + edges.extent / step) + 1
        counts = np.where(edges.hides, np.maximum(after - first, 0), 0).astype(np.intp)
        edge = np.repeat(np.arange(len(counts)), counts)
        begins = np.cumsum(counts) - counts
        sector = (np.arange(len(edge)) + (first.astype(np.intp) - begins)[edge]) % sectors
        cos, sin = _turn_rays(sectors, self.eye.yaw)
        near = np.full(sectors, 1.0 / self.range_m)
        found = edges.cos[edge] * cos[sector] + edges.sin[edge] * sin[sector]
        np.maximum.at(near, sector, found)
        return 1.0 / near

    def visible_rows(self, min_share: float) -> Bool:
        """Return an (N,) mask of the boxes of which more than nothing and at least `min_share` is visible."""
        fractions = self.visible_fractions()
        return (fractions > 0.0) & (fractions >= min_share)


def _turn_rays(count: int, yaw: float) -> tuple[Float, Float]:
    """Return cosines and sines (count,) of rays that are evenly spaced from yaw [rad] on, counter-clockwise."""
    cos, sin = portable.cos_sin(yaw)
    ray_cos, ray_sin = _build_rays(count)
    return ray_cos * cos - ray_sin * sin, ray_sin * cos + ray_cos * sin


@cache
def _build_rays(count: int) -> tuple[Float, Float]:
    return portable.cos_sin(np.arange(count) * (TAU / count))
