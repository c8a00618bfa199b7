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
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose

TIE = 1e-9
"""Edges whose 1/distance differs by less [1/m] are equally near: 0.01 mm at 100 m. Touching boxes do not flicker."""
LOW_M = 2.5
"""Static objects with a longer side up to this count as low: sensors look over cones, crates and barrier pieces."""
FLAT = 1e-9
"""The eye lies on an edge's line, and does not see it, below this value of twice their triangle [m2]."""


class BuildingEdges:
    """The building edges of a map, indexed by building."""

    def __init__(self, roads: RoadMap) -> None:
        """`roads` may have no buildings; their outlines may run either way round."""
        rings = [_counter_clockwise(np.array(building.polygon, dtype=np.float64)) for building in roads.buildings]
        sizes = [len(ring) for ring in rings]
        self.starts: Float = np.concatenate([np.zeros((0, 2)), *rings])
        """(W, 2) [m]"""
        self.ends: Float = np.concatenate([np.zeros((0, 2)), *(np.roll(ring, -1, axis=0) for ring in rings)])
        """(W, 2) [m]"""
        self._middles = np.array([(ring.min(0) + ring.max(0)) / 2 for ring in rings]).reshape(-1, 2)
        self._radii = np.array(
            [portable.hypot(*(ring - middle).T).max() for ring, middle in zip(rings, self._middles, strict=True)]
        )
        self._building = np.repeat(np.arange(len(rings)), sizes)

    def find_near(self, eye: SensorPose, reach_m: float) -> tuple[Float, Float]:
        """Return starts and ends (V, 2) [m] of the walls of all buildings within reach_m."""
        if not len(self._radii):
            return self.starts, self.ends
        gap = portable.hypot(self._middles[:, 0] - eye.x, self._middles[:, 1] - eye.y) - self._radii
        walls = (gap <= reach_m)[self._building]
        return self.starts[walls], self.ends[walls]


def _counter_clockwise(ring: Float) -> Float:
    after = np.roll(ring, -1, axis=0)
    area = (ring[:, 0] * after[:, 1] - after[:, 0] * ring[:, 1]).sum()
    return ring if area > 0 else ring[::-1]


class _Edges(NamedTuple):
    """The E edges that face the eye, as it sees them: from right to left, counter-clockwise."""

    right: Float
    """(E,) angle of one end [rad] in [-pi, pi]."""
    left: Float
    """(E,) of the other end; less than `right` if the edge lies across the direction -x."""
    cos: Float
    """(E,) with `sin`: 1/distance of the edge [1/m] towards angle a is cos * cos(a) + sin * sin(a)."""
    sin: Float
    owner: Int
    """(E,) row of the box, -1 for a wall."""
    hides: Bool
    """(E,) whether it hides what lies behind."""

    @property
    def extent(self) -> Float:
        """(E,) angular width [rad]."""
        return (self.left - self.right) % TAU


class _Pieces(NamedTuple):
    """Edges cut at the ends of all edges: P pieces, each of one edge in one of the intervals."""

    edge: npt.NDArray[np.intp]
    """(P,) index of the edge."""
    interval: npt.NDArray[np.intp]
    """(P,) index of the interval."""


def _cut_edges(first: npt.NDArray[np.intp], after: npt.NDArray[np.intp], intervals: int) -> _Pieces:
    """Each edge is in the intervals first ... after - 1, counted around the circle of so many intervals."""
    counts = np.where(after < first, after + intervals, after) - first
    edge = np.repeat(np.arange(len(counts)), counts)
    begins = np.cumsum(counts) - counts
    interval = np.arange(len(edge)) + (first - begins)[edge]
    return _Pieces(edge, np.where(interval >= intervals, interval - intervals, interval))


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
        b = self.scene.boxes
        x, y, (cos, sin) = b.x - self.eye.x, b.y - self.eye.y, portable.cos_sin(b.yaw)
        ahead = np.maximum(np.abs(cos * x + sin * y) - b.length / 2, 0.0)
        aside = np.maximum(np.abs(cos * y - sin * x) - b.width / 2, 0.0)
        gaps = portable.hypot(ahead, aside)
        if self.eye.carrier_row is not None:
            gaps[self.eye.carrier_row] = np.inf
        return gaps

    @cached_property
    def _edges(self) -> _Edges:
        b, eye = self.scene.boxes, self.eye
        rows = np.flatnonzero(self.distances <= self.range_m)
        corners = self.scene.corners[rows]
        # What lies wholly out of range is left out: it can hide only what is out of range too.
        starts, ends = self.buildings.find_near(eye, self.range_m)
        p = np.concatenate((corners.reshape(-1, 2), starts)) - (eye.x, eye.y)
        q = np.concatenate((corners[:, (1, 2, 3, 0)].reshape(-1, 2), ends)) - (eye.x, eye.y)
        owner = np.concatenate((np.repeat(rows, 4), np.full(len(starts), -1)))
        double_area = p[:, 0] * q[:, 1] - p[:, 1] * q[:, 0]
        facing = double_area < -FLAT
        p, q, owner, double_area = p[facing], q[facing], owner[facing], double_area[facing]
        left, right = portable.atan2(np.stack((p[:, 1], q[:, 1])), np.stack((p[:, 0], q[:, 0])))
        high = (b.kind == Kind.STATIC) & (np.maximum(b.length, b.width) > LOW_M)
        opaque = np.append((b.kind == Kind.VEHICLE) | high, True)  # the last one is of the walls
        side = (q - p) / double_area[:, None]
        return _Edges(right, left, side[:, 1], -side[:, 0], owner, opaque[owner])

    def visible_fractions(self) -> Float:
        """Return the visible share (N,) in [0, 1] of each box's angular width; 0 for the carrier and out of range."""
        edges = self._edges
        of_box = edges.owner >= 0
        count = len(self.distances)
        extent = np.bincount(edges.owner[of_box], edges.extent[of_box], count)
        seen = np.bincount(edges.owner[of_box], self._compute_visible_widths()[of_box], count)
        around = (self.distances <= self.range_m) & (extent == 0.0)  # no edge faces an eye inside
        return np.where(around, 1.0, np.clip(seen / np.where(extent > 0.0, extent, 1.0), 0.0, 1.0))

    def _compute_visible_widths(self) -> Float:
        """Return the visible angular width (E,) [rad] of each edge."""
        edges = self._edges
        if not len(edges.owner):
            return np.zeros(0)
        cuts = np.sort(np.concatenate((edges.right, edges.left)), kind="stable")
        edge, interval = _cut_edges(np.searchsorted(cuts, edges.right), np.searchsorted(cuts, edges.left), len(cuts))
        widths = np.diff(cuts, append=cuts[0] + TAU)
        hides, (cos, sin) = edges.hides[edge], portable.cos_sin(cuts)
        after = interval + 1
        after[after == len(cuts)] = 0
        begin = edges.cos[edge] * cos[interval] + edges.sin[edge] * sin[interval]
        end = edges.cos[edge] * cos[after] + edges.sin[edge] * sin[after]
        nearest = np.zeros((3, len(cuts)))
        for row, near in zip(nearest, (begin, end, begin + end), strict=True):
            np.maximum.at(row, interval[hides], near[hides])
        clear = (begin >= nearest[0, interval] - TIE) & (end >= nearest[1, interval] - TIE)
        seen = np.where(clear, widths[interval], 0.0)
        winner = hides & (begin + end >= nearest[2, interval])
        front = np.zeros((2, len(cuts)))
        front[:, interval[winner]] = begin[winner], end[winner]
        hidden = ~winner & (front[0, interval] >= begin - TIE) & (front[1, interval] >= end - TIE)
        for i in np.flatnonzero(~clear & ~hidden):
            others = edge[(interval == interval[i]) & hides & (edge != edge[i])]
            seen[i] = self._compute_visible_width(
                int(edge[i]), others, float(cuts[interval[i]]), float(widths[interval[i]])
            )
        return np.bincount(edge, seen, len(edges.owner)).astype(np.float64, copy=False)

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
