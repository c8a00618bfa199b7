"""People who stand beside the road and look across it: they may step out while a car comes."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mdrive_sumo.contract import Objects, VehicleFacts
from mdrive_sumo.core.geometry import Float, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.path import SPACING_M, Path
from mdrive_sumo.planning.path_overlap import cells_of, footprints, overlaps

STANDING_SPEED = 0.1
ACROSS: Float = np.arange(0.0, 14.0, 0.5)
"""[m] How far they may go straight on."""
SIDE_M = 0.5
STRIDE_CELLS = 2
CREEPING, BRAKING, SPARE_M = 3.0, 1.5, 2.0
"""A car comes to within that distance [m] of their way at a speed from which it can brake so gently [m/s2] to a
standstill, but at least so fast [m/s]: people who never step out would stop it for ever."""
SET_OFF_M, WALKING = 0.3, 1.5
"""Who is so far from where he was first seen is under way, and walks on so fast [m/s] as soon as he can."""


def walking_on(objects: Objects, first_seen: Mapping[str, tuple[float, float]]) -> Objects:
    """The objects; people who have set off and stand now (they let somebody pass) walk on."""
    speed = objects.speed.copy()
    for row in np.flatnonzero((objects.kind == Kind.PEDESTRIAN) & (np.abs(speed) < STANDING_SPEED)).tolist():
        x, y = first_seen.get(objects.ids[row], (objects.x[row], objects.y[row]))
        if np.hypot(objects.x[row] - x, objects.y[row] - y) > SET_OFF_M:
            speed[row] = WALKING
    return replace(objects, speed=speed)


def careful_speeds(path: Path, speeds: Float, objects: Objects, vehicle: VehicleFacts) -> Float:
    """The speeds (M,) [m/s] at the points of the path, less before people who stand and would walk across it."""
    rows = np.flatnonzero((objects.kind == Kind.PEDESTRIAN) & (np.abs(objects.speed) < STANDING_SPEED))
    if not len(rows):
        return speeds
    cells = cells_of(path, np.arange(0.0, path.goal_s, STRIDE_CELLS * SPACING_M))
    mine = footprints(path, vehicle.length, vehicle.width + 2 * SIDE_M, cells)
    stations = np.arange(len(path.xy)) * SPACING_M
    for row in rows.tolist():
        met = overlaps(mine, _strip(objects, row)).any(axis=1)
        if met.any():
            first, last = (float(cells[met][k]) * SPACING_M for k in (0, -1))
            allowed = np.sqrt(CREEPING**2 + 2 * BRAKING * np.maximum(first - SPARE_M - stations, 0.0))
            speeds = np.where(stations <= last, np.minimum(speeds, allowed), speeds)
    return speeds


def _strip(objects: Objects, row: int) -> Float:
    """Corners (K, 4, 2) [m] of where somebody may be who walks straight on."""
    x = objects.x[row] + ACROSS * np.cos(objects.yaw[row])
    y = objects.y[row] + ACROSS * np.sin(objects.yaw[row])
    return boxes_corners(x, y, objects.yaw[row], objects.length[row], objects.width[row])
