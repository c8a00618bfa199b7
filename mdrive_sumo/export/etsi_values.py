"""Values of ETSI messages: where stations are on the Earth, and the steps of angles, times and confidences.

Sources: ETSI TS 102 894-2 V1.3.1 (common data dictionary), for the CAM EN 302 637-2 V1.4.1.
"""

import math
from dataclasses import dataclass

from mdrive_sumo.core import portable
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.v2x.messages import ReferencePose

MS_PER_TICK = 1000 // TICKS_PER_SECOND
LATITUDE_M = 110_574.2758
"""Metres in a degree of latitude on the equator, WGS 84: pi / 180 x a (1 - e2), a = 6 378 137 m, e2 = 0.00669437999."""
LONGITUDE_M = 111_319.4908
"""Metres in a degree of longitude on the equator, WGS 84: pi / 180 x a."""
SIGMAS_95_LINE = 1.959964
"""Standard deviations within which 95 % of a normal distribution lie: ETSI's confidence level."""
SIGMAS_95_PLANE = 2.447747
"""The same for a circular normal distribution in the plane: the square root of -2 ln 0.05."""
PASSENGER_CAR, ROADSIDE_UNIT = 5, 15
"""Station types (TS 102 894-2, A.78)."""
UNAVAILABLE_ALTITUDE = 800_001
NORTH_DEG = 90.0
"""North in the frame of the recording: y points up, angles are counter-clockwise from +x."""


@dataclass(frozen=True, slots=True)
class EarthPlace:
    """A place on the Earth, in ETSI's steps of 0.1 microdegrees."""

    latitude: int
    longitude: int


def place_on_earth(x: float, y: float) -> EarthPlace:
    """Return where a point [m] of the network lies if its origin is at latitude 0, longitude 0, and y points north.

    Scenarios have no place on the Earth; on the equator a plane needs no projection.
    """
    return EarthPlace(round(y / LATITUDE_M * 1e7), round(x / LONGITUDE_M * 1e7))


def place_front(pose: ReferencePose, length_m: float) -> tuple[float, float]:
    """Return x and y [m] of the middle of the front side, the reference position of a vehicle (EN 302 637-2, B.19)."""
    cos, sin = portable.cos_sin(pose.yaw)
    return pose.x + cos * length_m / 2, pose.y + sin * length_m / 2


def to_heading(yaw: float) -> int:
    """Return a heading in steps of 0.1 degrees, clockwise from north (0 to 3599)."""
    return round((NORTH_DEG - math.degrees(yaw)) * 10) % 3600


def clamp(value: float, lowest: int, highest: int) -> int:
    """Return the value rounded, and at the ends of its range if it is beyond."""
    return min(max(round(value), lowest), highest)


def to_confidence(sigma: float, step: float, most: int = 125) -> int:
    """Return the half-width of the 95 % interval in steps, at least 1; most + 1 (out of range) if it is larger."""
    return min(max(math.ceil(sigma * SIGMAS_95_LINE / step), 1), most + 1)


def to_ellipse_axis(sigma: float) -> int:
    """Return a semi-axis of the 95 % ellipse of a position [cm]; 4094 stands for larger ones."""
    return clamp(sigma * SIGMAS_95_PLANE * 100, 0, 4094)


def to_delta_time(tick: int) -> int:
    """Return the time of a tick as generationDeltaTime: milliseconds modulo 65 536. Episodes begin at 0."""
    return tick * MS_PER_TICK % 65_536
