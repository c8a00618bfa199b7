"""Scene: the world of one tick as sensors need it, made once for all of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from hashlib import blake2b

from mdrive_sumo.contract import Briefing, Objects
from mdrive_sumo.core.geometry import Float, boxes_corners
from mdrive_sumo.core.state import EgoState
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.weather import Weather
from mdrive_sumo.v2x.messages import format_track_name


@dataclass(frozen=True)
class SensingFrame:
    """Everybody at one tick, by their true ids; the first rows are the CAVs, in the order of `egos`."""

    tick: int
    boxes: Objects
    egos: Mapping[str, EgoState]

    @cached_property
    def corners(self) -> Float:
        """(N, 4, 2) corners of all boxes [m]."""
        boxes = self.boxes
        return boxes_corners(boxes.x, boxes.y, boxes.yaw, boxes.length, boxes.width)


@dataclass(frozen=True, slots=True)
class SensorPose:
    """Where a sensor is carried: the pose of the CAV's box centre or of a road-side unit [m, rad]."""

    x: float
    y: float
    yaw: float
    carrier_row: int | None
    """The carrier's row in `SensingFrame.boxes`, which it neither sees nor is hidden by; None for a road-side unit."""


@dataclass(frozen=True, slots=True)
class SensorSetup:
    """What a sensor knows of the car and the world into which it is built."""

    carrier: str
    """Id of the CAV or RSU."""
    seed: int
    """Of this sensor's noise; draw with `seeding.uniforms`/`normals(seed, purpose, tick, object id...)` only."""
    roads: RoadMap
    weather: Weather
    briefing: Briefing | None
    """None for a road-side unit."""


def derive_track_name(carrier: str, true_id: str) -> str:
    """The track name under which a carrier sees something: the same in every tick, another one for every carrier.

    A perfect tracker is part of every sensor here; that two carriers see the same thing must be found out by them.
    """
    digest = blake2b(f"{carrier}\x00{true_id}".encode(), digest_size=4).digest()
    return format_track_name(int.from_bytes(digest, "big"))
