"""Cameras of pictures, from above (orthographic) and in perspective (a pinhole), and the areas that they project."""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, Self

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float, Int

NEAR_M, FAR_M = 0.5, 300.0
"""[m] Depths between which a pinhole camera shows something."""
SIDE_MARGIN = 1.05
"""Areas are cut off a little beside the picture, so that their cut edges do not show."""


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


class Camera(Protocol):
    """What pictures are projected with. Pixels: x to the right, y down, (0, 0) the upper left corner."""

    def project(self, rings: Rings) -> Rings:
        """Return the visible parts of areas in space [m] on the picture [px]."""
        ...

    def find_pixel(self, point: tuple[float, float, float]) -> tuple[float, float] | None:
        """Return where a point in space [m] is on the picture; None if it is not in front of the camera."""
        ...

    def project_segment(self, ends: Float) -> Float | None:
        """Return the visible part of a segment (2, 3) [m] on the picture (2, 2); None if there is none."""
        ...


@dataclass(frozen=True)
class TopCamera:
    """A camera that looks straight down, with north up; heights do not matter."""

    x: float
    """Middle of the picture in the world frame [m]."""
    y: float
    scale: float
    """Pixels of a metre [px/m]."""
    width: int
    """Width of the picture [px], as its height."""
    height: int

    def project(self, rings: Rings) -> Rings:
        """Return the areas on the picture; what lies beside the picture is kept."""
        return Rings(self._to_pixels(rings.points), rings.ring)

    def find_pixel(self, point: tuple[float, float, float]) -> tuple[float, float]:
        """Return where a point is on the picture, or beside it."""
        x, y = self._to_pixels(np.array(point)).tolist()
        return x, y

    def project_segment(self, ends: Float) -> Float:
        """Return a segment (2, 3) [m] on the picture (2, 2)."""
        return self._to_pixels(ends)

    def _to_pixels(self, points: Float) -> Float:
        middle, origin = np.array((self.width / 2, self.height / 2)), np.array((self.x, self.y))
        return middle + (points[..., :2] - origin) * (self.scale, -self.scale)


@dataclass(frozen=True)
class PerspectiveCamera:
    """A pinhole camera in space without roll."""

    x: float
    """Place in the world frame [m], as y; z is the height above the ground."""
    y: float
    z: float
    yaw: float
    """Direction of view [rad]."""
    pitch: float
    """Angle by which it looks down [rad]."""
    focal_px: float
    """Focal length [px]."""
    width: int
    """Width of the picture [px], as its height."""
    height: int

    @cached_property
    def _axes(self) -> Float:
        """Unit vectors (3, 3): to the right, down and ahead."""
        cos, sin, level, down = math.cos(self.yaw), math.sin(self.yaw), math.cos(self.pitch), math.sin(self.pitch)
        return np.array(((sin, -cos, 0.0), (-cos * down, -sin * down, -level), (cos * level, sin * level, -down)))

    def to_camera(self, points: Float) -> Float:
        """Return points (..., 3) [m] in the frame of the camera: to the right, down, ahead (the depth)."""
        relative = points - np.array((self.x, self.y, self.z))
        return np.stack([(relative * axis).sum(-1) for axis in self._axes], axis=-1)

    def project(self, rings: Rings) -> Rings:
        """Return the parts between the near and the far plane, and between the sides of the picture."""
        seen = Rings(self.to_camera(rings.points), rings.ring)
        seen = seen.clip(seen.points[:, 2] - NEAR_M)
        seen = seen.clip(FAR_M - seen.points[:, 2])
        slope = SIDE_MARGIN * self.width / 2 / self.focal_px
        seen = seen.clip(slope * seen.points[:, 2] - seen.points[:, 0])
        seen = seen.clip(slope * seen.points[:, 2] + seen.points[:, 0])
        return Rings(self._to_pixels(seen.points), seen.ring)

    def find_pixel(self, point: tuple[float, float, float]) -> tuple[float, float] | None:
        """Return where a point is on the picture, or beside it; None if it is behind the near plane."""
        seen = self.to_camera(np.array(point))
        if seen[2] < NEAR_M:
            return None
        x, y = self._to_pixels(seen).tolist()
        return x, y

    def project_segment(self, ends: Float) -> Float | None:
        """Return the part of a segment (2, 3) [m] before the near plane on the picture (2, 2); None if none is."""
        seen = self.to_camera(ends)
        depth = seen[:, 2]
        if (depth < NEAR_M).all():
            return None
        if (depth < NEAR_M).any():
            behind = int(np.argmin(depth))
            share = (NEAR_M - depth[behind]) / (depth[1 - behind] - depth[behind])
            seen[behind] += share * (seen[1 - behind] - seen[behind])
        return self._to_pixels(seen)

    def _to_pixels(self, seen: Float) -> Float:
        return np.array((self.width / 2, self.height / 2)) + self.focal_px * seen[..., :2] / seen[..., 2:]
