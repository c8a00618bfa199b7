"""Which sensors a data set records: those of the learned systems, each under a name of its rig."""

from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import TypeVar

from mdrive_sumo.agents.learned.system_spec import SYSTEMS, ImageInput, SystemSpec
from mdrive_sumo.contract import SensorSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import describe_unknown
from mdrive_sumo.sensing.sensor_options import MeasuringTicks

T = TypeVar("T")
SHARED_RIGS = {"uniad": "vad"}
"""A rig whose images another one has: six cameras of the same places, angles and sizes."""
RIG_NAMES = tuple(spec.rig for spec in SYSTEMS.values())


def find_recorded_rig(rig: str) -> str:
    """Return the name under which the images of a system's rig are stored. Raises InputError."""
    if rig not in RIG_NAMES:
        raise InputError(f"--rig: {describe_unknown(rig, RIG_NAMES)}")
    return SHARED_RIGS.get(rig, rig)


def parse_rig_names(rigs: Iterable[str]) -> tuple[str, ...]:
    """Return the rigs to record, each once, in alphabetical order. Raises InputError for an unknown name."""
    return tuple(sorted({find_recorded_rig(rig) for rig in rigs}))


def find_rig_system(rig: str) -> SystemSpec:
    """Return the system whose sensors a recorded rig has."""
    return next(spec for spec in SYSTEMS.values() if spec.rig == rig)


def format_sensor_id(rig: str, sensor: str) -> str:
    """Return the id of a recorded camera or LiDAR: rigs may have cameras of the same name."""
    return f"{rig}-{sensor}"


def build_rig_sensors(
    rigs: Iterable[str], ticks: MeasuringTicks | None = None, driven_by: str = ""
) -> tuple[SensorSpec, ...]:
    """Return the cameras and LiDARs of recorded rigs, renamed by `format_sensor_id`.

    ticks: when they are recorded, None: always, as that of `driven_by` is, with which a learner sees.
    """
    sensors = [(rig, spec) for rig in rigs for spec in find_rig_system(rig).build_sensors()]
    turns = {} if ticks is None else {"on_ticks": ticks.on, "cycle_ticks": ticks.cycle, "cycle_start": ticks.start}
    return tuple(
        replace(
            spec,
            id=format_sensor_id(rig, spec.id),
            options=spec.options if rig == driven_by else {**spec.options, **turns},
        )
        for rig, spec in sensors
        if spec.kind in ("camera", "lidar")
    )


def list_stored_images(spec: SystemSpec, image: ImageInput) -> tuple[str, ...]:
    """Return the names of the stored images (RIG-CAMERA) of one input of a system."""
    rig = find_recorded_rig(spec.rig)
    return tuple(format_sensor_id(rig, camera) for camera in image.cameras)


def select_rig_outputs(spec: SystemSpec, outputs: Mapping[str, T]) -> dict[str, T]:
    """Return the images or scans of a system's own sensors, by the ids that it knows."""
    prefix = format_sensor_id(find_recorded_rig(spec.rig), "")
    return {name.removeprefix(prefix): value for name, value in outputs.items() if name.startswith(prefix)}
