"""Write recordings as V2XPnP logs: agent folders of 10 Hz YAML. The original logs cannot be shipped.

The text equals PyYAML's output for the dataset's fields to the last space, so that the reader is tested on the real
layout. A recording is planar: z and the other two angles are 0, heights are typical values.
"""

import math
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.output_files import make_folder, write_text
from real2sim.readers.v2xpnp import DT_S
from real2sim.recording import ObjectCategory, ObserverView, RecordedTrack, Recording
from real2sim.writers.observation_noise import ObservationNoise, assign_numbers, simulate_observers

LABEL_BY_CATEGORY: Mapping[ObjectCategory, str] = {
    ObjectCategory.CAR: "Car",
    ObjectCategory.VAN: "Van",
    ObjectCategory.TRUCK: "Truck",
    ObjectCategory.BUS: "Bus",
    ObjectCategory.MOTORCYCLE: "Motorcycle",
    ObjectCategory.BICYCLE: "BicycleRider",
    ObjectCategory.PEDESTRIAN: "Pedestrian",
    ObjectCategory.STATIC: "TrashCan",
}
_HALF_HEIGHT_M = 0.75
"""[m] Of every box, and its centre above the ground: the format has heights, a scenario has none."""
_DECIMALS = 3
"""Millimetres and thousandths of a degree."""


def write_v2xpnp(truth: Recording, folder: Path, noise: ObservationNoise | None, seed: int) -> dict[str, str]:
    """Write what the observers of a known scene would have recorded; return the number of each track id.

    `truth` and `noise` are those of `simulate_observers`.
    """
    write_views(simulate_observers(truth, noise, seed), folder)
    return assign_numbers(truth)


def write_views(recording: Recording, folder: Path) -> None:
    """Write every view to a folder named after its observer.

    Raises ValueError unless observers and ids are numbers and frames are 0.1 s apart. The format requires a yaw:
    unknown ones are written as 0. Unknown sizes are written as 0, which the reader treats as unknown.
    """
    if not math.isclose(recording.dt_s, DT_S):
        raise ValueError(f"V2XPnP has frames {DT_S} s apart, not {recording.dt_s} s")
    for view in recording.views:
        if not view.observer.removeprefix("-").isdecimal() or not all(k.id.isdecimal() for k in view.tracks):
            raise ValueError(f"V2XPnP has numbers for observers and ids, not those of view {view.observer!r}")
        target = folder / view.observer
        make_folder(target)
        for t, text in enumerate(_format_frames(view, recording.frame_count)):
            write_text(target / f"{t:06d}.yaml", text)


def _format_frames(view: ObserverView, frames: int) -> list[str]:
    """Return the text of every frame."""
    objects: list[list[str]] = [[] for _ in range(frames)]
    for track in sorted(view.tracks, key=lambda track: int(track.id)):
        for t, numbers in zip(track.valid_frames.tolist(), _tabulate(track), strict=True):
            objects[t].append(_format_object(track, numbers))
    yaws = np.degrees(view.pose[:, 2])
    heads = [_format_head(view, x, y, yaw) for (x, y, _), yaw in zip(view.pose.tolist(), yaws.tolist(), strict=True)]
    return [head + ("\n" + "".join(rows) if rows else " {}\n") for head, rows in zip(heads, objects, strict=True)]


def _tabulate(track: RecordedTrack) -> list[list[float]]:
    """Return rows of x, y, yaw [degrees], half length, half width of the valid frames."""
    rows = np.column_stack((track.xy, np.degrees(track.yaw), track.length / 2, track.width / 2))[track.valid_frames]
    filled: Float = np.where(np.isnan(rows), 0.0, rows)
    return filled.tolist()


def _format_number(value: float) -> str:
    return repr(round(value, _DECIMALS))


def _format_head(view: ObserverView, x: float, y: float, yaw_deg: float) -> str:
    height = 4.0 if view.is_infrastructure else 1.9
    pose = "".join(f"- {_format_number(value)}\n" for value in (x, y, height, 0.0, yaw_deg, 0.0))
    infra = "true" if view.is_infrastructure else "false"
    return f"ego_speed: 0\ninfra: {infra}\nlidar_pose:\n{pose}true_ego_pose:\n{pose}vehicles:"


def _format_object(track: RecordedTrack, numbers: list[float]) -> str:
    x, y, yaw, half_length, half_width = map(_format_number, numbers)
    attribute, label = "static" if track.parked else "''", LABEL_BY_CATEGORY[track.category]
    return (
        f"  {track.id}:\n    angle:\n    - 0.0\n    - {yaw}\n    - 0.0\n    attribute: {attribute}\n"
        f"    center:\n    - 0\n    - 0\n    - 0\n"
        f"    extent:\n    - {half_length}\n    - {half_width}\n    - {_HALF_HEIGHT_M}\n"
        f"    location:\n    - {x}\n    - {y}\n    - {_HALF_HEIGHT_M}\n    obj_type: {label}\n"
    )
