"""Outlines of areas as arrays: many are clipped and projected at once."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Self

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, Int


@dataclass(frozen=True, slots=True)
class Rings:
    """Closed outlines of areas, one after the other, without their first point at the end."""

    points: Float
    """(P, D): in space [m] or on a picture [px]."""
    ring: Int
    """(P,): number of the ring that each point belongs to, ascending."""

    @classmethod
    def concat(cls, outlines: Iterable[Float]) -> Self:
        """Return the outlines, each (K, D)."""
        parts = [outline for outline in outlines if len(outline)]
        points = np.concatenate(parts) if parts else np.zeros((0, 3))
        return cls(points, np.repeat(np.arange(len(parts)), [len(part) for part in parts]))

    @property
    def starts(self) -> Int:
        """Return the index (R,) of the first point of every ring that has one."""
        return np.flatnonzero(np.diff(self.ring, prepend=-1))

    @property
    def numbers(self) -> Int:
        """Return the numbers (R,) of the rings that have points."""
        return self.ring[self.starts]

    def split(self) -> list[Float]:
        """Return one array (K, D) for each ring that has points."""
        return np.split(self.points, self.starts[1:]) if len(self.points) else []

    def clip(self, distance: Float) -> "Rings":
        """Return the parts where `distance` (P,), linear in space, is not negative (Sutherland and Hodgman, 1974)."""
        inside = distance >= 0
        if inside.all():
            return self
        following = np.arange(1, len(self.points) + 1)
        starts = self.starts
        following[np.append(starts[1:], len(self.points)) - 1] = starts
        crossing = inside != inside[following]
        count = inside.astype(np.int64) + crossing
        place = np.cumsum(count) - count
        points = np.empty((int(count.sum()), self.points.shape[1]))
        points[place[inside]] = self.points[inside]
        a, b = np.flatnonzero(crossing), following[crossing]
        share = (distance[a] / (distance[a] - distance[b]))[:, None]
        points[place[crossing] + inside[crossing]] = self.points[a] + share * (self.points[b] - self.points[a])
        return Rings(points, np.repeat(self.ring, count))


def build_rings(shapes: Iterable[shapely.Polygon], height: float = 0.0) -> Rings:
    """Return outlines and holes of polygons at a height [m].

    Outlines are counter-clockwise, holes clockwise: areas that overlap are filled once, holes are not.
    """
    oriented = (shapely.orient_polygons(shape) for shape in shapes)
    rings = (ring for shape in oriented for ring in (shape.exterior, *shape.interiors))
    return Rings.concat(lift(shapely.get_coordinates(ring)[:-1], height) for ring in rings)


def lift(xy: Float, height: float) -> Float:
    """Return points (..., 2) as points in space (..., 3)."""
    return np.concatenate((xy, np.full((*xy.shape[:-1], 1), height)), axis=-1)
