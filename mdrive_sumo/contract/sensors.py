"""Sensor declarations, the output types of the sensors, and the sensing tracks of runs that follow from them."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from enum import IntEnum, StrEnum
from types import MappingProxyType
from typing import Literal

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import RoadUsers

NO_OPTIONS: Mapping[str, float | str | bool] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class SensorSpec:
    """A sensor that an agent asks for. Only what is declared is computed; docs/sensors.md lists kinds and options.

    "objects" (detections of what is in sight), "lidar", "camera", "bev" (bird's-eye raster), "gnss", "imu",
    "speedometer", and "privileged" (every state, every route and every CAV's latest plan), which labels the run
    `privileged`.
    """

    kind: str
    """Kind of sensor, e.g. "objects"."""
    id: str = ""
    """Name of its output; several sensors of kind lidar, camera or bev need different ones."""
    range_m: float = 100.0
    """How far an "objects" sensor reaches [m]; the others have fixed or optional ranges."""
    options: Mapping[str, float | str | bool] = field(default_factory=lambda: NO_OPTIONS)
    """Options of the kind by name."""


@dataclass(frozen=True, slots=True)
class Objects(RoadUsers):
    """Boxes of other road users and obstacles. Struct of arrays, all (N,); nearest first."""

    ids: tuple[str, ...]
    """A sensor names tracks per observer: the same object keeps its name from tick to tick, and other observers give
    it other names. Only the privileged sensor uses true ids."""
    free_m: Float = field(default_factory=lambda: np.zeros(0))
    """(B,) how far sight is free [m] in B equal sectors, counter-clockwise from straight ahead; each value belongs to
    the ray at the beginning of its sector. Empty unless an objects sensor has the option `free_space`."""


@dataclass(frozen=True, slots=True)
class Detections:
    """What an agent takes to be around its car in the tick of the observation; open loop scores it (`eval-open`)."""

    boxes: Float
    """(N, 5): x, y [m] of the box centre in the world frame, yaw [rad], length, width [m]."""
    scores: Float
    """(N,) confidence in [0, 1]: only its order counts."""

    @classmethod
    def from_objects(cls, objects: RoadUsers) -> "Detections":
        """Return the boxes of objects or tracks, all with score 1: the first ones count as the most certain."""
        columns = (objects.x, objects.y, objects.yaw, objects.length, objects.width)
        return cls(np.stack(columns, axis=-1), np.ones(len(objects.ids)))


@dataclass(frozen=True, slots=True)
class PointCloud:
    """One LiDAR scan in the sensor's own frame (x ahead, y left, z up)."""

    points: npt.NDArray[np.float32]
    """(N, 4): x, y, z [m], intensity in [0, 1]."""
    hit: npt.NDArray[np.int32]
    """(N,) index into `names` of what each point lies on, -1 for the ground; empty unless the option hit_ids is set."""
    names: tuple[str, ...]
    """Track names as in `Objects.ids`, "building:ID" for buildings."""


@dataclass(frozen=True, slots=True)
class Raster:
    """A bird's-eye view centred on the car, which looks up (row 0 is ahead, column 0 is left)."""

    layers: tuple[str, ...]
    """Name of each layer of `pixels`."""
    pixels: npt.NDArray[np.uint8]
    """(layers, H, W), 0 or 255."""
    metres_per_pixel: float
    """Edge of a pixel on the road [m]."""


@dataclass(frozen=True, slots=True)
class CameraImage:
    """An image of a pinhole camera; row 0 is the top."""

    kind: str
    """"rgb", "semantic", "depth" or "instance"."""
    pixels: npt.NDArray[np.uint8] | npt.NDArray[np.float32] | npt.NDArray[np.int32]
    """rgb: (H, W, 3) uint8; semantic: (H, W) uint8 of `SemanticClass`; depth: (H, W) float32 [m] along the optical
    axis, 1000 for the sky; instance: (H, W) int32 indices into `names`, -1 for what is no road user."""
    focal_px: float
    """Focal length [pixels]; the principal point is the middle of the image."""
    names: tuple[str, ...] = ()
    """Of an instance image: track names as in `Objects.ids`."""


@dataclass(frozen=True, slots=True)
class Gnss:
    """Where a satellite receiver at the box centre takes itself to be (WGS 84)."""

    latitude_deg: float
    """[deg], positive to the north."""
    longitude_deg: float
    """[deg], positive to the east."""
    altitude_m: float
    """[m]; roads are flat, at altitude 0."""


@dataclass(frozen=True, slots=True)
class Imu:
    """Inertial unit at the box centre, in the car's frame (x ahead, y left, z up)."""

    acceleration: tuple[float, float, float]
    """[m/s2], gravity included: (0, 0, 9.81) for a car at rest."""
    angular_rate: tuple[float, float, float]
    """[rad/s]"""
    compass: float
    """Direction of the car [rad], clockwise from north (+y), in [0, 2 pi), as CARLA gives it."""


class SemanticClass(IntEnum):
    """What a pixel shows, by the numbers of CARLA 0.9.12, the paper's version, without classes that do not occur."""

    UNLABELLED = 0
    BUILDING = 1
    PEDESTRIAN = 4
    """Also the rider of a bicycle or motorcycle, as in CARLA."""
    POLE = 5
    ROAD_LINE = 6
    ROAD = 7
    SIDEWALK = 8
    VEHICLE = 10
    """Also bicycles and motorcycles without their riders, as in CARLA."""
    TRAFFIC_SIGN = 12
    SKY = 13
    TRAFFIC_LIGHT = 18
    STATIC = 19
    TERRAIN = 22


class SensingTrack(StrEnum):
    """What the CAVs of a run perceive with: lists of objects, or only what a car carries.

    It follows from the sensors that agents declare in an episode, which are all that the evaluator computes for them,
    never from what an agent says (docs/decisions/057-sensor-track-and-object-track.md). `sensing.sensor_kinds` derives
    it.
    """

    SENSOR = "sensor"
    """Only what a car carries: LiDAR, cameras, GNSS, IMU, speedometer, map and V2X messages."""
    OBJECT = "object"
    """At least one CAV is given objects: by the sensors `objects`, `bev` or `privileged`, by named LiDAR points, or by
    labelled images."""


TrackName = Literal["", "sensor", "object"]
"""A `SensingTrack` as text; "": unknown, of void scenarios and of logs."""


def join_sensing_tracks(tracks: Iterable[str]) -> TrackName:
    """Return the track of several episodes: `object` if any is; unknown ("") if any is or there are none; `sensor`."""
    different = set(tracks)
    if SensingTrack.OBJECT in different:
        return "object"
    return "sensor" if different == {SensingTrack.SENSOR} else ""
