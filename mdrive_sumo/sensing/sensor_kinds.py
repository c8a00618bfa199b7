"""The kinds of sensors: one row each says how a kind is built, what it fills, what it costs and what it counts as.

All that treats kinds differently reads `SENSOR_KINDS`: observations, the sensing track of an episode, the limits of
boxed agents, lamps that only cameras see. What a sensor returns is a number or a dataclass that `contract` exports, so
`agent_process.wire_protocol` carries it to agents in other processes.
"""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Protocol

from mdrive_sumo.contract import SensingTrack, SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.sensing.camera.camera_sensor import CameraSensor, find_camera_labels, price_camera
from mdrive_sumo.sensing.lidar_sensor import LidarSensor, find_lidar_labels, price_lidar
from mdrive_sumo.sensing.navigation_sensors import GnssSensor, ImuSensor, SpeedometerSensor
from mdrive_sumo.sensing.objects_sensor import ObjectsSensor
from mdrive_sumo.sensing.raster_sensor import RasterSensor, price_raster
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup

BUDGET_MS = 40.0
"""Price of all sensors of a CAV together [ms a tick]: a raster of 1024 pixels, a LiDAR and objects cost 37."""
SMALL_MS = 0.05
"""Satellite receiver, inertial unit, speedometer [ms]."""
OBJECTS_MS = 1.5
"""Objects within range, whatever its options [ms]; measured 0.8 to 1.5."""
CAMERA_WORDS = frozenset({"camera", "rgb", "rgba", "depth", "semantic", "segmentation", "fisheye", "image"})
"""Words in the names that other simulators and data sets give to cameras."""


class Sensor(Protocol):
    """One sensor of one CAV."""

    def sense(self, scene: SensingFrame, eye: SensorPose) -> Any:
        """Return what the sensor measures in this tick; None in ticks without a measurement."""
        ...


def _give_no_objects(spec: SensorSpec) -> str:  # noqa: ARG001  # common signature
    return ""


@dataclass(frozen=True, slots=True)
class SensorKind:
    """One kind of sensor."""

    field: str
    """The field of `Observation` that it fills."""
    build: Callable[[SensorSpec, SensorSetup], Sensor] | None
    """Builds a sensor; raises InputError for invalid options. None: `ObservationBuilder` itself fills the field."""
    price: Callable[[SensorSpec], float] = lambda _: SMALL_MS
    """Returns the CPU time [ms a tick] that it costs the evaluator; with unusable options that of the dearest."""
    find_objects: Callable[[SensorSpec], str] = lambda spec: repr(spec.kind)
    """Returns by what the sensor gives objects, e.g. "'lidar' with hit_ids"; "" for what a car carries. By default a
    kind belongs to the object track (docs/decisions/057-sensor-track-and-object-track.md)."""
    is_named: bool = False
    """Whether a CAV may have several, told apart by `SensorSpec.id`; the field then maps ids to measurements."""
    has_large_arrays: bool = False
    """Whether its measurements are so large that a boxed agent may have only some (`runs.open_agents`)."""
    draws_ideal_sight: bool = False
    """Whether it draws what an ideal detector sees within `SensorSpec.range_m` (`SensorSetup.look`)."""
    shows_lamps: bool = False
    """Whether it shows brake lamps and indicators, which are then observed in every tick."""
    knows_everything: bool = False
    """Whether it labels the run `privileged`; its CAV knows its own state exactly."""


SENSOR_KINDS: Mapping[str, SensorKind] = MappingProxyType(
    {
        "objects": SensorKind("objects", ObjectsSensor, lambda _: OBJECTS_MS),
        "gnss": SensorKind("gnss", GnssSensor, find_objects=_give_no_objects),
        "imu": SensorKind("imu", ImuSensor, find_objects=_give_no_objects),
        "speedometer": SensorKind("speedometer", SpeedometerSensor, find_objects=_give_no_objects),
        "lidar": SensorKind("lidar", LidarSensor, price_lidar, find_lidar_labels, is_named=True, has_large_arrays=True),
        "camera": SensorKind(
            *("cameras", CameraSensor, price_camera, find_camera_labels),
            is_named=True,
            has_large_arrays=True,
            shows_lamps=True,
        ),
        "bev": SensorKind(
            "bev", RasterSensor, price_raster, is_named=True, has_large_arrays=True, draws_ideal_sight=True
        ),
        "privileged": SensorKind("privileged", None, knows_everything=True),
    }
)
"""Every kind by the name that agents declare, in the order in which they are computed."""


def find_kind(spec: SensorSpec) -> SensorKind:
    """Return the kind of a declared sensor. Raises InputError for a kind that does not exist."""
    kind = SENSOR_KINDS.get(spec.kind)
    if kind is None:
        known = f"sensor {spec.kind!r}: expected one of {', '.join(SENSOR_KINDS)}, found none of that kind"
        raise InputError(describe_camera_error(spec.kind) or known)
    return kind


def describe_camera_error(kind: str) -> str:
    """Return the error for other names of a camera ("rgb", "sensor.camera.depth", "CAM_FRONT"); "" for other kinds."""
    words = re.split(r"[^a-z]+", kind.lower())
    if not CAMERA_WORDS.isdisjoint(words) or words[0] == "cam":
        return (
            f'sensor {kind!r}: expected the sensor "camera" with an option kind ("rgb", "semantic", "depth" or '
            '"instance"), found another name of a camera'
        )
    return ""


def price_sensor(spec: SensorSpec) -> float:
    """Return the price of a sensor in CPU time [ms a tick]. Unusable options cost the most; the sensor refuses them.

    Prices are linear models of the time of a call, fitted to `python tests/bench/sensors.py` (two shared cores, 100
    road users and 40 buildings around the car): at most 10 % below the measured medians. A competing agent may use them
    within a budget.
    """
    kind = SENSOR_KINDS.get(spec.kind)
    return SMALL_MS if kind is None else kind.price(spec)


def check_sensor_budget(sensors: Sequence[SensorSpec]) -> None:
    """Raise InputError if the sensors of a CAV cost more than `BUDGET_MS`; the sentence names the dearest one."""
    prices = [price_sensor(spec) for spec in sensors]
    if (total := sum(prices)) <= BUDGET_MS:
        return
    price, dearest = max(zip(prices, sensors, strict=True), key=lambda pair: pair[0])
    raise InputError(
        f"sensors: expected a price of at most {BUDGET_MS:g} ms a tick for each car (docs/sensors.md, prices), found "
        f"{total:.1f} ms for {len(sensors)} sensors, of which {dearest.kind!r} {dearest.id!r:.40} costs {price:.1f} ms"
    )


def find_object_source(sensors: Iterable[SensorSpec]) -> str:
    """Return the first sensor that gives objects, e.g. "'lidar' with hit_ids"; "" if none does.

    A kind that does not exist counts, so a new one belongs to the object track until its row says otherwise.
    """
    for spec in sensors:
        kind = SENSOR_KINDS.get(spec.kind)
        if source := repr(spec.kind) if kind is None else kind.find_objects(spec):
            return source
    return ""


def derive_sensing_track(sensors: Iterable[Sequence[SensorSpec]]) -> SensingTrack:
    """Return the track of an episode from the sensors of every CAV: one that is given objects decides for all.

    It can tell the others by messages.
    """
    return SensingTrack.OBJECT if any(find_object_source(specs) for specs in sensors) else SensingTrack.SENSOR
