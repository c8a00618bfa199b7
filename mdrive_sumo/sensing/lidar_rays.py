"""Rays of a LiDAR: where they point from the car, in columns of equal azimuth or one by one."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import TAU, Float, Int

Float32 = npt.NDArray[np.float32]

UPRIGHT_TAN = 1e6
"""Rays steeper than this count as so steep: they move a hundredth of a millimetre while they fall 10 m."""


@dataclass(frozen=True, slots=True)
class LidarRays:
    """Columns of rays with one azimuth each. A sensor that leans has as many columns as rays."""

    azimuth: Float
    """(A,) ascending in [0, 2 pi), counter-clockwise from straight ahead of the level sensor."""
    across: Float
    """(A, 2) unit vectors of the azimuths."""
    climb: Float
    """(C,) tangents of elevation, ascending, that all columns have; or (A,) if every ray is its own column."""
    shared: bool
    """Which of the two `climb` is."""
    order: Int
    """(rays,) which ray of the scan each (column, channel) is."""
    slope: Float
    """(rays,) tangent of elevation of each ray of the scan."""
    stretch: Float32
    """(rays,) length of each ray of the scan per horizontal metre."""
    local: Float32
    """(rays, 3) unit vectors of the rays of the scan in the sensor's frame."""


def compute_elevations(channels: int, lower_deg: float, upper_deg: float) -> Float:
    """Elevations (C,) [rad] from the lowest to the highest channel."""
    return np.radians(np.linspace(lower_deg, upper_deg, channels))


def rotation_matrix(roll: float, pitch: float, yaw: float) -> Float:
    """Right-handed rotation (3, 3) about x, then y, then z [rad]."""
    (cr, sr), (cp, sp), (cy, sy) = (portable.cos_sin(a) for a in (roll, pitch, yaw))
    about_x = np.array(((1, 0, 0), (0, cr, -sr), (0, sr, cr)))
    about_y = np.array(((cp, 0, sp), (0, 1, 0), (-sp, 0, cp)))
    about_z = np.array(((cy, -sy, 0), (sy, cy, 0), (0, 0, 1)))
    return _multiply(_multiply(about_z, about_y), about_x)


def _multiply(first: Float, second: Float) -> Float:
    """Return the matrix product."""
    return portable.dot(first[:, None], second.T)


def compute_directions(columns: int, elevation: Float) -> Float:
    """Unit vectors (columns * C, 3): from straight ahead counter-clockwise, in each column from the lowest channel."""
    azimuth = np.repeat(TAU * np.arange(columns) / columns, len(elevation))
    height = np.tile(elevation, columns)
    (cos, sin), (level, up) = portable.cos_sin(azimuth), portable.cos_sin(height)
    return np.stack((level * cos, level * sin, up), axis=-1)


def build_upright_rays(columns: int, elevation: Float) -> LidarRays:
    """The rays of a sensor that stands upright."""
    azimuth, climb = TAU * np.arange(columns) / columns, portable.tan(elevation)
    local = compute_directions(columns, elevation)
    return _rays(azimuth, climb, np.arange(len(local)), np.tile(climb, columns), local)


def build_tilted_rays(columns: int, elevation: Float, roll: float, pitch: float) -> LidarRays:
    """The rays of a sensor that leans, each a column of its own."""
    local = compute_directions(columns, elevation)
    level = _multiply(local, rotation_matrix(roll, pitch, 0.0).T)
    azimuth = portable.atan2(level[:, 1], level[:, 0]) % TAU
    azimuth[azimuth >= TAU] = 0.0  # what % makes of the smallest negative numbers
    order = np.argsort(azimuth, kind="stable")
    slope = level[:, 2] / np.maximum(portable.hypot(level[:, 0], level[:, 1]), 1 / UPRIGHT_TAN)
    return _rays(azimuth[order], slope[order], order, slope, local)


def _rays(azimuth: Float, climb: Float, order: Int, slope: Float, local: Float) -> LidarRays:
    across = np.stack(portable.cos_sin(azimuth), axis=-1)
    stretch, shared = np.sqrt(1 + slope * slope).astype(np.float32), len(climb) < len(order)
    return LidarRays(azimuth, across, climb, shared, order, slope, stretch, local.astype(np.float32))
