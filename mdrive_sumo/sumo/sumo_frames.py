"""Convert between SUMO's poses (front bumper, degrees clockwise from north) and ours (box centre, radians from +x)."""

import math

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Actors


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


@twin
def place_actors(
    template: Actors, fronts: list[tuple[float, float]], angles_deg: list[float], speeds: list[float], /
) -> Actors:
    """Return the actors of a template with other poses: front bumpers (N, 2) [m], SUMO headings [deg], speeds [m/s]."""
    yaw = convert_sumo_angles(np.array(angles_deg, dtype=np.float64))
    cos, sin = portable.cos_sin(yaw)
    front_x, front_y = np.array(fronts, dtype=np.float64).reshape(-1, 2).T
    half, speed = template.length / 2, np.array(speeds, dtype=np.float64)
    x, y = front_x - cos * half, front_y - sin * half
    return Actors(template.ids, template.kind, x, y, yaw, speed, template.length, template.width)
