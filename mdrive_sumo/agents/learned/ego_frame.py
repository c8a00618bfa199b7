"""Points between the world frame and the ego frame (x ahead, y left of the box centre)."""

import numpy as np

from mdrive_sumo.contract import OwnState
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float


def convert_to_ego(points: Float, own: OwnState) -> Float:
    """Return world points (N, 2) [m] in the ego frame."""
    return convert_to_frame(points, np.array((own.x, own.y, own.yaw)))


def convert_to_frame(points: Float, pose: Float) -> Float:
    """Return world points (..., 2) [m] in the frame of a pose (3,): x, y [m], yaw [rad]."""
    cos, sin = portable.cos_sin(float(pose[2]))
    x, y = points[..., 0] - pose[0], points[..., 1] - pose[1]
    return np.stack((cos * x + sin * y, cos * y - sin * x), axis=-1)


def convert_to_world(points: Float, own: OwnState) -> Float:
    """Return points (N, 2) [m] of the ego frame in the world frame."""
    cos, sin = portable.cos_sin(own.yaw)
    x, y = points[:, 0], points[:, 1]
    return np.stack((own.x + cos * x - sin * y, own.y + sin * x + cos * y), axis=-1)
