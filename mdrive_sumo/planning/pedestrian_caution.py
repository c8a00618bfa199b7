"""Caution near pedestrians who stand beside the road and face it: they may step out while a car approaches."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mdrive_sumo.contract import Objects, VehicleFacts
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, boxes_corners
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.parameters import PEDESTRIAN, PedestrianParameters
from mdrive_sumo.planning.path_overlap import compute_footprints, compute_overlaps, find_cells
from mdrive_sumo.planning.reference_path import SPACING_M, ReferencePath


def predict_walking_on(
    objects: Objects, first_positions: Mapping[str, tuple[float, float]], parameters: PedestrianParameters = PEDESTRIAN
) -> Objects:
    """Return the objects with the speed of pedestrians who have started to cross and stand now set to walking speed.

    first_positions: first observed position (x, y) [m] by object id.
    """
    return replace(objects, speed=predict_walking_speeds(objects, first_positions, parameters))


@twin
def predict_walking_speeds(
    objects: Objects, first_positions: Mapping[str, tuple[float, float]], parameters: PedestrianParameters, /
) -> Float:
    """Return the speeds (N,) [m/s] of `predict_walking_on`."""
    speed = objects.speed.copy()
    standing = (objects.kind == Kind.PEDESTRIAN) & (np.abs(speed) < parameters.standing_speed)
    for row in np.flatnonzero(standing).tolist():
        x, y = first_positions.get(objects.ids[row], (objects.x[row], objects.y[row]))
        if portable.hypot(objects.x[row] - x, objects.y[row] - y) > parameters.started_m:
            speed[row] = parameters.walking_speed
    return speed


def limit_speeds_near_pedestrians(
    path: ReferencePath,
    speeds: Float,
    objects: Objects,
    vehicle: VehicleFacts,
    parameters: PedestrianParameters = PEDESTRIAN,
) -> Float:
    """Return the speed limits (M,) [m/s] at the points of the path, reduced before standing pedestrians who face it."""
    standing = (objects.kind == Kind.PEDESTRIAN) & (np.abs(objects.speed) < parameters.standing_speed)
    rows = np.flatnonzero(standing)
    if not len(rows):
        return speeds
    cells = find_cells(path, np.arange(0.0, path.goal_s, parameters.stride_cells * SPACING_M))
    mine = compute_footprints(path, vehicle.length, vehicle.width + 2 * parameters.side_gap_m, cells)
    stations = np.arange(len(path.xy)) * SPACING_M
    for row in rows.tolist():
        met = compute_overlaps(mine, _sweep_straight_on(objects, row, parameters)).any(axis=1)
        if met.any():
            first, last = (float(cells[met][k]) * SPACING_M for k in (0, -1))
            room = np.maximum(first - parameters.gap_m - stations, 0.0)
            allowed = np.sqrt(parameters.creeping_speed * parameters.creeping_speed + 2 * parameters.braking * room)
            speeds = np.where(stations <= last, np.minimum(speeds, allowed), speeds)
    return speeds


def _sweep_straight_on(objects: Objects, row: int, parameters: PedestrianParameters) -> Float:
    """Return the corners (K, 4, 2) [m] of the boxes that a pedestrian covers by walking straight on."""
    walked = np.arange(0.0, parameters.crossing_m, parameters.crossing_step_m)
    cos, sin = portable.cos_sin(objects.yaw[row])
    x, y = objects.x[row] + walked * cos, objects.y[row] + walked * sin
    return boxes_corners(x, y, objects.yaw[row], objects.length[row], objects.width[row])
