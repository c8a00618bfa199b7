"""Frames: SUMO's pose is the front bumper and degrees clockwise from north; ours the box centre and radians from +x."""

import math

import numpy as np

from mdrive_sumo.core.geometry import Float


def yaws_from_sumo(angles_deg: Float) -> Float:
    """SUMO headings (N,) [deg, clockwise from north] -> yaws [rad, counter-clockwise from +x] in [-pi, pi)."""
    return np.radians((270.0 - angles_deg) % 360.0 - 180.0)


def angle_to_sumo(yaw: float) -> float:
    """Yaw [rad] -> SUMO heading [deg] in [0, 360)."""
    return math.degrees(math.pi / 2 - yaw) % 360.0


def front_bumper(x: float, y: float, yaw: float, length: float) -> tuple[float, float]:
    """Box centre -> the front bumper point that SUMO calls the position."""
    return x + math.cos(yaw) * length / 2, y + math.sin(yaw) * length / 2
