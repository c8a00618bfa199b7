"""Convert between SUMO's poses (front bumper, degrees clockwise from north) and ours (box centre, radians from +x)."""

import math

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float


def convert_sumo_angles(angles_deg: Float) -> Float:
    """Return SUMO headings (N,) [deg, clockwise from north] as yaws [rad, counter-clockwise from +x] in [-pi, pi)."""
    return np.radians((270.0 - angles_deg) % 360.0 - 180.0)


def convert_yaw_to_sumo(yaw: float) -> float:
    """Return a yaw [rad] as SUMO heading [deg] in [0, 360)."""
    return math.degrees(math.pi / 2 - yaw) % 360.0


def compute_front_bumper(x: float, y: float, yaw: float, length: float) -> tuple[float, float]:
    """Return the front bumper point of a box, which SUMO calls the position."""
    cos, sin = portable.cos_sin(yaw)
    return x + cos * length / 2, y + sin * length / 2
