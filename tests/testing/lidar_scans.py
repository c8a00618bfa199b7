"""LiDAR sensors, scenes of boxes and their scans: shared by tests of the LiDAR. No tests in here."""

import math
from dataclasses import replace

import numpy as np

from mdrive_sumo.contract import Briefing, Objects, PointCloud, SensorSpec, VehicleFacts
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.network_file import Building
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.lidar_sensor import LidarSensor
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup
from testing.worlds import straight_road

CAR = VehicleFacts(4.9, 2.1, 2.85, 1.4, 1700.0, 1.2, 50.0, 3.0, 8.0)
ELEVATION = np.radians(np.linspace(-30.0, 10.0, 64))
COLUMNS = 391
OWN = (Kind.VEHICLE, 0.0, 0.0, 0.0, 4.9, 2.1)

Box = tuple[Kind, float, float, float, float, float]
Ring = tuple[tuple[float, float], ...]
Option = float | str | bool


def height_of(box: Box) -> float:
    """As documented, in our own words."""
    kind, length = box[0], box[4]
    if kind == Kind.VEHICLE:
        return 1.5 if length < 5.5 else 2.2 if length < 7.5 else 3.4
    return 1.0 if kind == Kind.STATIC else 1.75


def town(*rings: Ring) -> RoadMap:
    return replace(straight_road(), buildings=tuple(Building(id=f"h{i}", polygon=r) for i, r in enumerate(rings)))


def make_briefing(vehicle: VehicleFacts = CAR) -> Briefing:
    xy = np.array([(0.0, 0.0), (1.0, 0.0)])
    zero = np.zeros(2)
    return Briefing("a", 0, 0.05, 30.0, vehicle, xy, zero, np.arange(2.0), zero + 3.5, zero + 10.0)


def sensor(roads: RoadMap | None = None, weather: str = "default", seed: int = 5, **options: Option) -> LidarSensor:
    fitting = SensorSetup("a", seed, roads or town(), WEATHERS[weather], make_briefing())
    return LidarSensor(SensorSpec("lidar", "top", options=options), fitting)


def scene(*boxes: Box, tick: int = 0) -> SensingFrame:
    x, y, yaw, length, width = np.array([box[1:] for box in boxes]).T
    kinds = np.array([box[0] for box in boxes], dtype=np.uint8)
    ids = tuple("abcdefghijklmnopqrstuvwxyz"[: len(boxes)])
    return SensingFrame(tick, Objects(ids, kinds, x, y, yaw, np.zeros(len(boxes)), length, width), {})


def scan(of: LidarSensor, *others: Box, own: Box = OWN, tick: int = 0) -> PointCloud:
    cloud = of.sense(scene(own, *others, tick=tick), SensorPose(own[1], own[2], own[3], 0))
    assert cloud is not None
    return cloud


def rotation(roll: float, pitch: float, yaw: float) -> Float:
    """By Rodrigues' formula about each axis in turn."""
    total = np.eye(3)
    for axis, angle in ((0, roll), (1, pitch), (2, yaw)):
        k = np.cross(np.eye(3)[axis], np.eye(3)).T
        total = (np.eye(3) + math.sin(angle) * k + (1 - math.cos(angle)) * k @ k) @ total
    return total


def ray_of(points: Float) -> np.ndarray:
    """Which ray of the scan each point is, by its direction."""
    column = np.rint(np.arctan2(points[:, 1], points[:, 0]) / (2 * math.pi) * COLUMNS).astype(int) % COLUMNS
    up = np.degrees(np.arctan2(points[:, 2], np.hypot(points[:, 0], points[:, 1])))
    return column * 64 + np.rint((up + 30) / 40 * 63).astype(int)
