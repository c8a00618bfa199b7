"""Cameras of pictures: from above (orthographic), and from behind a vehicle (a pinhole)."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.report.render.rings import Rings

NEAR_M, FAR_M = 0.5, 300.0
"""[m] Depths between which a pinhole camera shows something."""
SIDE_MARGIN = 1.05
"""Areas are cut off a little beside the picture, so that their cut edges do not show."""


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
    """World frame, middle of the picture [m]."""
    y: float
    scale: float
    """[px/m]"""
    width: int
    """[px]"""
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
class ChaseCamera:
    """A pinhole camera in space without roll."""

    x: float
    """World frame [m]."""
    y: float
    z: float
    yaw: float
    """Direction of view [rad]."""
    pitch: float
    """Downwards [rad]."""
    focal_px: float
    """Focal length [px]."""
    width: int
    """[px]"""
    height: int

    @cached_property
    def _axes(self) -> Float:
        """Unit vectors (3, 3): to the right, down and ahead."""
        cos, sin, level, down = math.cos(self.yaw), math.sin(self.yaw), math.cos(self.pitch), math.sin(self.pitch)
        return np.array(((sin, -cos, 0.0), (-cos * down, -sin * down, -level), (cos * level, sin * level, -down)))

    @property
    def horizon(self) -> float:
        """Row of the horizon [px], which may be beside the picture."""
        return self.height / 2 - self.focal_px * math.tan(self.pitch)

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
