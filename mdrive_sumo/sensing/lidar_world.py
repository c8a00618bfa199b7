"""Targets of a LiDAR, with assumed heights and reflectivities, which SUMO's flat world lacks."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
import shapely

from mdrive_sumo.contract import Objects
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Int
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.sensing.lidar_cast import LidarBoxes, LidarWalls

VAN_LENGTH_M, TRUCK_LENGTH_M = 5.5, 7.5
"""From these lengths on, a vehicle is as high as a van, and as a truck or bus."""
CAR_M, VAN_M, TRUCK_M = 1.5, 2.2, 3.4
"""[m] Heights of cars, vans, and trucks or buses: assumptions, usual sizes of their kinds."""
HEIGHT_OF_KIND_M = np.array((CAR_M, 1.75, 1.75, 1.0))
"""Assumed heights [m] by `Kind`: car, pedestrian, cyclist, static obstacle."""
BUILDING_M = 10.0
"""[m] Higher than every mount of a LiDAR and every vehicle: a wall hides all that is behind it (`lidar_cast`)."""

GROUND_REFLECTIVITY, BUILDING_REFLECTIVITY = 0.2, 0.5
"""Assumptions: asphalt is dark, facades are between it and car paint."""
REFLECTIVITY_OF_KIND = np.array((0.8, 0.4, 0.5, 0.6))
"""Assumed reflectivities by `Kind`: a vehicle reflects most. SUMO has no materials."""


@dataclass(frozen=True, slots=True)
class LidarPose:
    """Pose of the level sensor in the world: x, y, height [m] and yaw [rad]."""

    x: float
    y: float
    z: float
    yaw: float

    def to_local(self, xy: Float) -> Float:
        """Return world points (..., 2) [m] in the frame of the level sensor."""
        cos, sin = portable.cos_sin(self.yaw)
        x, y = xy[..., 0] - self.x, xy[..., 1] - self.y
        return np.stack((cos * x + sin * y, cos * y - sin * x), axis=-1)


def assume_vehicle_height(length: float) -> float:
    """Height [m] assumed for a vehicle of this length [m]."""
    return CAR_M if length < VAN_LENGTH_M else VAN_M if length < TRUCK_LENGTH_M else TRUCK_M


def assume_vehicle_heights(length: Float) -> Float:
    """Heights (N,) [m] assumed for vehicles of these lengths [m]."""
    return np.where(length < VAN_LENGTH_M, CAR_M, np.where(length < TRUCK_LENGTH_M, VAN_M, TRUCK_M))


def assume_heights(kind: npt.NDArray[np.uint8], length: Float) -> Float:
    """Heights (N,) [m] assumed for boxes of these kinds and lengths [m]."""
    return np.where(kind == Kind.VEHICLE, assume_vehicle_heights(length), HEIGHT_OF_KIND_M[kind])


@dataclass(frozen=True, slots=True)
class BuildingOutlines:
    """All walls of a map (E, 2) [m] with their outside to the right, and the building (E,) of each."""

    start: Float
    end: Float
    building: Int


@lru_cache(maxsize=8)
def load_building_outlines(roads: RoadMap) -> BuildingOutlines:
    """The buildings' walls."""
    rings = [
        np.asarray(shapely.orient_polygons(shape, exterior_cw=False).exterior.coords) for shape in roads.building_shapes
    ]
    none = np.zeros((0, 2))
    start = np.concatenate((none, *(ring[:-1] for ring in rings)))
    end = np.concatenate((none, *(ring[1:] for ring in rings)))
    return BuildingOutlines(start, end, np.repeat(np.arange(len(rings)), [len(ring) - 1 for ring in rings]))


def select_boxes(boxes: Objects, without: int | None, place: LidarPose, reach: float) -> LidarBoxes:
    """Boxes whose centre is within `reach` [m] beside their size; owners are 1 + row."""
    xy = place.to_local(np.stack((boxes.x, boxes.y), axis=-1))
    close = portable.hypot(xy[:, 0], xy[:, 1]) < reach + boxes.length + boxes.width
    if without is not None:
        close[without] = False
    rows = np.flatnonzero(close)
    length = boxes.length[rows]
    top = assume_heights(boxes.kind[rows], length) - place.z
    x, y = xy[rows].T
    return LidarBoxes(x, y, boxes.yaw[rows] - place.yaw, length, boxes.width[rows], top, rows + 1)


def select_walls(of: BuildingOutlines, place: LidarPose, reach: float, first_owner: int) -> LidarWalls:
    """Walls that come within `reach` [m] of the place."""
    start, end = place.to_local(of.start), place.to_local(of.end)
    along = end - start
    foot = np.clip(-(start * along).sum(1) / np.maximum((along * along).sum(1), 1e-12), 0, 1)[:, None]
    close = portable.square(start + foot * along).sum(1) <= reach * reach
    return LidarWalls(start[close], end[close], BUILDING_M - place.z, of.building[close] + first_owner)


def assume_reflectivities(boxes: Objects, buildings: int) -> npt.NDArray[np.float32]:
    """By owner: the ground, the boxes, the buildings."""
    of_boxes = REFLECTIVITY_OF_KIND[boxes.kind]
    values = np.concatenate(((GROUND_REFLECTIVITY,), of_boxes, np.full(buildings, BUILDING_REFLECTIVITY)))
    return values.astype(np.float32)
