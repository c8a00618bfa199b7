"""SensingFrame: the world of one tick as input of all sensors, built once per tick."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from hashlib import blake2b
from types import MappingProxyType
from typing import Any, TypeVar

from mdrive_sumo.contract import Briefing, Objects
from mdrive_sumo.contract.detector_profiles import IDEAL
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import EgoState
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.weather import Weather
from mdrive_sumo.v2x.messages import format_track_name

DerivedT = TypeVar("DerivedT")
LOW_M = 2.5
"""Static objects with a longer side up to this count as low: sensors look over cones, crates and barrier pieces."""


@dataclass(frozen=True)
class SensingFrame:
    """All road users of one tick by true id; the first rows are the CAVs, in the order of `egos`."""

    tick: int
    boxes: Objects
    egos: Mapping[str, EgoState]
    signals: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """States of traffic lights (SUMO letters) by id; only cameras see them here."""
    signal_lamps: Mapping[str, int] = field(default_factory=lambda: MappingProxyType({}))
    """`SignalLamp`s of vehicles that shine, by true id; only cameras see them."""
    derived: dict[type[Any], list[Any]] = field(default_factory=dict[type[Any], list[Any]], compare=False, repr=False)
    """What sensors compute of this frame for each other, by type, see `list_derived`. A pure cache."""

    def list_derived(self, kind: type[DerivedT]) -> list[DerivedT]:
        """Return what was computed of this type so far; sensors append what they compute."""
        return self.derived.setdefault(kind, [])

    @cached_property
    def directions(self) -> tuple[Float, Float]:
        """Cosines and sines (N,) of the yaws of all boxes."""
        return portable.cos_sin(self.boxes.yaw)


@dataclass(frozen=True, slots=True)
class SensorPose:
    """Pose of a sensor's carrier: box centre of the CAV, or road-side unit [m, rad]."""

    x: float
    y: float
    yaw: float
    carrier_row: int | None
    """The carrier's row in `SensingFrame.boxes`, which the sensor ignores; None for a road-side unit."""
    estimate: EgoState | None = None
    """What the carrier takes its own state to be: detections are placed in the world by it. None: the true state."""

    def to_estimate(self) -> "SensorPose":
        """Return the pose where the carrier takes itself to be."""
        own = self.estimate
        return self if own is None else SensorPose(own.x, own.y, own.yaw, self.carrier_row)

    def place_by_estimate(self, objects: Objects) -> Objects:
        """Return objects where a carrier that relies on its estimated pose places them in the world."""
        own = self.estimate
        if own is None:
            return objects
        turn = own.yaw - self.yaw
        cos, sin = portable.cos_sin(turn)
        dx, dy = objects.x - self.x, objects.y - self.y
        x, y = own.x + cos * dx - sin * dy, own.y + sin * dx + cos * dy
        rest = objects.speed, objects.length, objects.width, objects.free_m
        return Objects(objects.ids, objects.kind, x, y, objects.yaw + turn, *rest)


@dataclass(frozen=True, slots=True)
class SensorSetup:
    """Static inputs of one sensor: its carrier, random seed, map and weather."""

    carrier: str
    """Id of the CAV or RSU."""
    seed: int
    """Seed of this sensor's noise; draw with `seeding.uniforms`/`normals(seed, purpose, tick, object id...)` only."""
    roads: RoadMap
    weather: Weather
    briefing: Briefing | None
    """None for a road-side unit."""
    track_salt: int = 0
    """Salt of the track names of this carrier in this episode; the same for all its sensors."""
    standard_detector: str = IDEAL
    """The detector profile that `standard` stands for."""
    look: Callable[[SensingFrame, SensorPose], Objects] = lambda _scene, _eye: Objects.empty()
    """What an ideal detector of the carrier sees, for sensors that draw it; by default nothing."""


def derive_track_name(carrier: str, true_id: str, salt: int = 0) -> str:
    """Return the track name of an object for a carrier: constant over time, different for every carrier.

    Every sensor includes a perfect tracker; agents must associate the tracks of different carriers themselves.
    salt: of the carrier in this episode, so that an agent cannot compute which track is which CAV.
    """
    digest = blake2b(f"{salt}\x00{carrier}\x00{true_id}".encode(), digest_size=4).digest()
    return format_track_name(int.from_bytes(digest, "big"))


class TrackNames(dict[str, str]):
    """Track names of a carrier by true id, each derived when it is first asked for."""

    def __init__(self, carrier: str, salt: int) -> None:
        self._carrier, self._salt = carrier, salt

    def __missing__(self, true_id: str) -> str:
        name = self[true_id] = derive_track_name(self._carrier, true_id, self._salt)
        return name
