"""Exact line of sight in the plane: visible share of each box past vehicles, static props and buildings.

A ray from the eye meets a box or building first on an edge that faces the eye, so only those edges matter. The angles
of their ends cut the circle into intervals, in each of which the same edges lie side by side; 1/distance of an edge is
A cos + B sin of the direction, so that two edges of an interval change places at most once, at a known angle.
Nothing is sampled. Pedestrians, cyclists and low props (cones, crates) hide nothing. A box or building that contains
the eye (after a collision, or by its mounting) hides nothing, and a box around the eye is fully visible.
"""

import math
from bisect import bisect_left
from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import TAU, Bool, Float, box_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.sensing.building_edges import BuildingEdges
from mdrive_sumo.sensing.sensing_frame import LOW_M, SensingFrame, SensorPose

__all__ = ["BuildingEdges", "SightView", "compute_visible_fractions", "measure_distances", "measure_free_sight"]

TIE = 1e-9
"""Edges whose 1/distance differs by less [1/m] are equally near: 0.01 mm at 100 m. Touching boxes do not flicker."""
FLAT = 1e-9
"""The eye lies on an edge's line, and does not see it, below this value of twice their triangle [m2]."""


@dataclass(frozen=True, slots=True)
class SightView:
    """Visibility from one sensor pose within range_m."""

    eye: SensorPose
    scene: SensingFrame
    buildings: BuildingEdges
    range_m: float

    def distances(self) -> Float:
        """Return `measure_distances` of the scene."""
        return measure_distances(self.scene.boxes, self.eye)

    def visible_fractions(self) -> Float:
        """Return `compute_visible_fractions` of the scene."""
        return compute_visible_fractions(self.scene.boxes, self.eye, self.range_m, self.buildings)

    def free_sight(self, sectors: int) -> Float:
        """Return `measure_free_sight` in the scene."""
        return measure_free_sight(self.scene.boxes, self.eye, self.range_m, self.buildings, sectors)

    def visible_rows(self, min_share: float) -> Bool:
        """Return an (N,) mask of the boxes of which more than nothing and at least `min_share` is visible."""
        fractions = self.visible_fractions()
        return (fractions > 0.0) & (fractions >= min_share)


@twin
def measure_distances(boxes: Objects, eye: SensorPose, /) -> Float:
    """Return the distance (N,) [m] to the nearest point of each box; infinite for the carrier's own."""
    distances = np.empty(len(boxes))
    columns = (boxes.x, boxes.y, boxes.yaw, boxes.length, boxes.width)
    for row, (x, y, yaw, length, width) in enumerate(zip(*(column.tolist() for column in columns), strict=True)):
        (cos, sin), dx, dy = portable.cos_sin(yaw), x - eye.x, y - eye.y
        ahead = max(abs(cos * dx + sin * dy) - length / 2, 0.0)
        aside = max(abs(cos * dy - sin * dx) - width / 2, 0.0)
        distances[row] = math.inf if row == eye.carrier_row else portable.hypot(ahead, aside)
    return distances


class _Edge(NamedTuple):
    """An edge that faces the eye, as the eye sees it: from right to left, counter-clockwise."""

    right: float
    """Angle of one end [rad] in [-pi, pi]."""
    left: float
    """Angle of the other end; less than `right` if the edge lies across the direction -x."""
    cos: float
    """With `sin`: 1/distance of the edge [1/m] towards angle a is cos * cos(a) + sin * sin(a)."""
    sin: float
    extent: float
    """Angular width [rad]."""
    box: int
    """Row of its box; -1: a wall."""
    hides: bool
    """Whether it hides what lies behind."""

    def invert_distance(self, direction: tuple[float, float]) -> float:
        return self.cos * direction[0] + self.sin * direction[1]


def _find_edges(boxes: Objects, eye: SensorPose, range_m: float, buildings: BuildingEdges) -> list[_Edge]:
    """Return the edges that face the eye, those of boxes first.

    What lies wholly out of range is left out: it can hide only what is out of range too.
    """
    edges: list[_Edge] = []
    for row in np.flatnonzero(measure_distances(boxes, eye) <= range_m).tolist():
        size = float(boxes.length[row]), float(boxes.width[row])
        is_high = boxes.kind[row] == Kind.STATIC and max(size) > LOW_M
        hides = bool(boxes.kind[row] == Kind.VEHICLE or is_high)
        corners = box_corners(float(boxes.x[row]), float(boxes.y[row]), float(boxes.yaw[row]), *size).tolist()
        for start, end in pairwise((*corners, corners[0])):
            _add_edge(edges, eye, (*start, *end), row, hides)
    for wall in buildings.find_near(eye.x, eye.y, range_m):
        _add_edge(edges, eye, wall, -1, True)
    return edges


def _add_edge(
    edges: list[_Edge], eye: SensorPose, ends: tuple[float, float, float, float], box: int, hides: bool
) -> None:
    """Add an edge if it faces the eye. ends: x and y of its start and end [m], counter-clockwise around its owner."""
    px, py, qx, qy = ends[0] - eye.x, ends[1] - eye.y, ends[2] - eye.x, ends[3] - eye.y
    double_area = px * qy - py * qx
    if double_area < -FLAT:
        left, right = portable.atan2(py, px), portable.atan2(qy, qx)
        cos, sin = (qy - py) / double_area, -((qx - px) / double_area)
        edges.append(_Edge(right, left, cos, sin, (left - right) % TAU, box, hides))


@dataclass(slots=True)
class _Interval:
    """An interval between two neighbouring ends of edges, and the nearest of the opaque edges within it."""

    angle: float
    """Where it begins [rad]."""
    width: float
    """[rad]"""
    begin: tuple[float, float]
    """Cosine and sine of the angle where it begins."""
    end: tuple[float, float]
    """Cosine and sine of the angle where it ends."""
    opaque: list[_Edge] = field(default_factory=list[_Edge])
    nearest: tuple[float, float, float] = 0.0, 0.0, 0.0
    """Greatest 1/distance [1/m] at the beginning and the end, and the greatest sum of both."""
    front: tuple[float, float] = 0.0, 0.0
    """1/distance [1/m] at the beginning and the end of the edge with the greatest sum."""

    def add_opaque(self, edge: _Edge) -> None:
        begin, end = edge.invert_distance(self.begin), edge.invert_distance(self.end)
        nearest = self.nearest
        if begin + end >= nearest[2]:
            self.front = begin, end
        self.nearest = max(nearest[0], begin), max(nearest[1], end), max(nearest[2], begin + end)
        self.opaque.append(edge)

    def measure_visible(self, edge: _Edge) -> float:
        """Return the visible width [rad] of an edge within the interval."""
        begin, end = edge.invert_distance(self.begin), edge.invert_distance(self.end)
        if begin >= self.nearest[0] - TIE and end >= self.nearest[1] - TIE:
            return self.width
        is_front = edge.hides and begin + end >= self.nearest[2]
        if self.front[0] >= begin - TIE and self.front[1] >= end - TIE and not is_front:
            return 0.0
        return self._measure_between(edge)

    def _measure_between(self, edge: _Edge) -> float:
        """Return the visible width [rad] of an edge where boxes overlap."""
        since, until = 0.0, self.width
        last_direction = portable.cos_sin(self.angle + self.width)
        for other in self.opaque:
            if other is edge:
                continue
            a, b = other.cos - edge.cos, other.sin - edge.sin
            hides_first = a * self.begin[0] + b * self.begin[1] > 0.0
            hides_last = a * last_direction[0] + b * last_direction[1] > 0.0
            change = min((portable.atan2(-a, b) - self.angle) % math.pi, self.width)
            if hides_first:
                since = max(since, self.width if hides_last else change)
            elif hides_last:
                until = min(until, change)
        return max(0.0, until - since)


def _cut_circle(edges: list[_Edge]) -> list[_Interval]:
    """Return the intervals around the eye, counter-clockwise from -pi, cut at the ends of all edges."""
    angles = sorted([angle for edge in edges for angle in (edge.right, edge.left)])
    directions = [portable.cos_sin(angle) for angle in angles]
    following = (*angles[1:], *(angle + TAU for angle in angles[:1]))
    return [
        _Interval(angle, beyond - angle, begin, end)
        for angle, beyond, begin, end in zip(
            angles, following, directions, directions[1:] + directions[:1], strict=True
        )
    ]


def _list_intervals(intervals: list[_Interval], edge: _Edge) -> Iterator[_Interval]:
    """Yield the intervals in which an edge lies, from right to left."""
    first, after = (bisect_left(intervals, angle, key=lambda one: one.angle) for angle in (edge.right, edge.left))
    yield from intervals[first:after] if first <= after else (*intervals[first:], *intervals[:after])


@twin
def compute_visible_fractions(boxes: Objects, eye: SensorPose, range_m: float, buildings: BuildingEdges, /) -> Float:
    """Return the visible share (N,) in [0, 1] of each box's angular width; 0 for the carrier and out of range."""
    edges = _find_edges(boxes, eye, range_m, buildings)
    intervals = _cut_circle(edges)
    for edge in edges:
        if edge.hides:
            for interval in _list_intervals(intervals, edge):
                interval.add_opaque(edge)
    extents, widths = [0.0] * len(boxes), [0.0] * len(boxes)
    for edge in edges:
        if edge.box >= 0:
            width = 0.0
            for interval in _list_intervals(intervals, edge):
                width += interval.measure_visible(edge)
            extents[edge.box] += edge.extent
            widths[edge.box] += width
    fractions = np.zeros(len(boxes))
    for row in np.flatnonzero(measure_distances(boxes, eye) <= range_m).tolist():
        # No edge faces an eye inside.
        fractions[row] = min(max(widths[row] / extents[row], 0.0), 1.0) if extents[row] > 0.0 else 1.0
    return fractions


@twin
def measure_free_sight(
    boxes: Objects, eye: SensorPose, range_m: float, buildings: BuildingEdges, sectors: int, /
) -> Float:
    """Return the distance (sectors,) [m] to the first building, vehicle or high static box, at most range_m.

    Each value belongs to the ray at the beginning of its equal sector, counter-clockwise from the eye's yaw.
    """
    step, (cos, sin) = TAU / sectors, portable.cos_sin(eye.yaw)
    rays = [portable.cos_sin(sector * step) for sector in range(sectors)]
    rays = [(x * cos - y * sin, y * cos + x * sin) for x, y in rays]
    nearest = [1.0 / range_m] * sectors
    for edge in _find_edges(boxes, eye, range_m, buildings):
        if edge.hides:
            turned = ((edge.right - eye.yaw) % TAU) / step
            for count in range(math.ceil(turned), math.floor(turned + edge.extent / step) + 1):
                sector = count % sectors
                nearest[sector] = max(nearest[sector], edge.invert_distance(rays[sector]))
    return np.array([1.0 / inverse_m for inverse_m in nearest])
