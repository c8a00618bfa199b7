"""CameraModel: image size, pinhole and pose of a camera, and its projection."""

import math
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float

NEAR_PLANE_M, FAR_PLANE_M = 0.1, 1000.0
"""[m] Depths between which a camera shows something. FAR_PLANE_M is also the depth of the sky, as in CARLA."""
VIEW_M = 400.0
"""[m] What is farther away is left out."""
LEAST_LEVEL, MOST_ROLL = 0.9, 0.2
"""Horizontal part of the optical axis, and vertical part of the axis to the left, up to which things outside of the
horizontal field of view are left out."""


class ImageKind(StrEnum):
    """What the pixels of an image hold."""

    RGB = "rgb"
    SEMANTIC = "semantic"
    DEPTH = "depth"
    INSTANCE = "instance"


@dataclass(frozen=True, slots=True)
class CameraMount:
    """Pose relative to the box centre on the ground, right-handed: x ahead, y left, z up [m]; angles [rad].

    Turns about x (roll), then y (pitch: positive looks down), then z (yaw: positive looks to the left).
    """

    x: float
    y: float
    z: float
    roll: float = 0.0
    pitch: float = 0.0
    yaw: float = 0.0

    @property
    def rotation(self) -> Float:
        """(3, 3) directions of the camera's axes (ahead, left, up) as columns, in the car's frame."""
        (cr, sr), (cp, sp), (cy, sy) = (portable.cos_sin(angle) for angle in (self.roll, self.pitch, self.yaw))
        about_x = np.array(((1.0, 0.0, 0.0), (0.0, cr, -sr), (0.0, sr, cr)))
        about_y = np.array(((cp, 0.0, sp), (0.0, 1.0, 0.0), (-sp, 0.0, cp)))
        about_z = np.array(((cy, -sy, 0.0), (sy, cy, 0.0), (0.0, 0.0, 1.0)))
        return about_z @ about_y @ about_x


@dataclass(frozen=True, slots=True)
class CameraView:
    """Pose of a camera in the world: place (3,) [m] and axes (3, 3) (ahead, left, up as columns)."""

    place: Float
    axes: Float

    def to_camera(self, points: Float) -> Float:
        """Return world points (..., 3) [m] in the camera's frame: ahead (the depth), left, up [m]."""
        return (points - self.place) @ self.axes


@dataclass(frozen=True, slots=True)
class CameraModel:
    """A pinhole camera with square pixels and its principal point in the middle of the image."""

    kind: ImageKind
    width: int
    height: int
    fov_deg: float
    """Horizontal field of view, as in CARLA."""
    mount: CameraMount

    @property
    def focal_px(self) -> float:
        """Focal length [pixels]."""
        return self.width / 2 / portable.tan(math.radians(self.fov_deg) / 2)

    def find_view(self, x: float, y: float, yaw: float) -> CameraView:
        """Return the camera's pose for a car with its box centre at x, y [m] and heading yaw [rad]."""
        cos, sin = portable.cos_sin(yaw)
        turn = np.array(((cos, -sin, 0.0), (sin, cos, 0.0), (0.0, 0.0, 1.0)))
        mount = np.array((self.mount.x, self.mount.y, self.mount.z))
        return CameraView(np.array((x, y, 0.0)) + turn @ mount, turn @ self.mount.rotation)

    def may_show(self, view: CameraView, centre: Float, radius: Float) -> Bool:
        """Return which discs on the ground (K,), with centres (K, 2) and radii (K,) [m], may be in the picture."""
        ahead, step = view.axes[:2, 0], centre - view.place[:2]
        near = portable.hypot(step[:, 0], step[:, 1]) < VIEW_M + radius
        level = float(portable.hypot(ahead[0], ahead[1]))
        half = math.radians(self.fov_deg) / 2
        cosine, sine = portable.cos_sin(half)
        if level < LEAST_LEVEL or abs(view.axes[2, 1]) > MOST_ROLL:  # looks up or down, or lies on its side
            return near
        along = (step @ ahead) / level
        aside = np.abs(step[:, 0] * ahead[1] - step[:, 1] * ahead[0]) / level
        wide = radius + (1.0 - level) * portable.hypot(step[:, 0], step[:, 1])  # a pitch widens what the image covers
        return near & (along * sine - aside * cosine > -wide) & (along > -wide)

    def project(self, view: CameraView, points: Float) -> Float:
        """Return column, row [pixels from the corner of the image] and depth [m] (..., 3) of world points (..., 3).

        Columns and rows mean something where the depth is positive. The centre of pixel (r, c) is (c + 0.5, r + 0.5).
        """
        ahead, left, up = np.moveaxis(view.to_camera(points), -1, 0)
        with np.errstate(divide="ignore", invalid="ignore"):
            columns = self.width / 2 - self.focal_px * left / ahead
            rows = self.height / 2 - self.focal_px * up / ahead
        return np.stack((columns, rows, ahead), axis=-1)

    def build_clip_matrix(self, view: CameraView, origin: Float) -> Float:
        """Return the matrix (4, 4) from points relative to `origin` (3,) to OpenGL's clip space, row 0 first."""
        across, down = 2 * self.focal_px / self.width, 2 * self.focal_px / self.height
        depth = (
            (FAR_PLANE_M + NEAR_PLANE_M) / (FAR_PLANE_M - NEAR_PLANE_M),
            -2 * FAR_PLANE_M * NEAR_PLANE_M / (FAR_PLANE_M - NEAR_PLANE_M),
        )
        project = np.array(
            ((0.0, -across, 0.0, 0.0), (0.0, 0.0, -down, 0.0), (depth[0], 0.0, 0.0, depth[1]), (1.0, 0.0, 0.0, 0.0))
        )
        pose = np.eye(4)
        pose[:3, :3] = view.axes.T
        pose[:3, 3] = view.axes.T @ (origin - view.place)
        return project @ pose
