"""Sensing tracks: whether the CAVs of a run are given lists of objects, or only what a car carries.

A track follows from the sensors that agents declare in an episode, which are all that the evaluator computes for them,
never from what an agent says (docs/decisions/057-sensor-track-and-object-track.md).
"""

from collections.abc import Iterable, Sequence
from enum import StrEnum
from typing import Literal

from mdrive_sumo.contract.sensors import SensorSpec

CARRIED = ("lidar", "camera", "gnss", "imu", "speedometer")
"""Kinds of sensors that a car carries and that report no objects. Own state, route, lane widths, speed limits, states
of traffic lights and V2X messages come with every observation."""
HIT_IDS = "hit_ids"
"""Option of a LiDAR that says which object each point lies on: a list of objects by another name."""


class SensingTrack(StrEnum):
    """What the CAVs of a run perceive with."""

    SENSOR = "sensor"
    """Only what a car carries: LiDAR, cameras, GNSS, IMU, speedometer, map and V2X messages."""
    OBJECT = "object"
    """At least one CAV is given objects: by the sensors `objects`, `bev` or `privileged`, by named LiDAR points, or by
    labelled images."""


LABELLED_IMAGES = ("semantic", "instance")
"""Kinds of camera images that say what each pixel shows."""
TrackName = Literal["", "sensor", "object"]
"""A `SensingTrack` as text; "": unknown, of results from before tracks existed."""


def find_object_source(sensors: Iterable[SensorSpec]) -> str:
    """Return the first sensor that gives objects, e.g. "'lidar' with hit_ids"; "" if none does.

    Every kind outside of `CARRIED` counts, so a new sensor belongs to the object track until it is entered there.
    """
    for spec in sensors:
        if spec.kind not in CARRIED:
            return repr(spec.kind)
        if spec.kind == "lidar" and spec.options.get(HIT_IDS, False):
            return f"{spec.kind!r} with {HIT_IDS}"
        if spec.kind == "camera" and spec.options.get("kind") in LABELLED_IMAGES:
            return f"{spec.kind!r} of kind {spec.options['kind']!r}"
    return ""


def derive_sensing_track(sensors: Iterable[Sequence[SensorSpec]]) -> SensingTrack:
    """Return the track of an episode from the sensors of every CAV: one that is given objects decides for all.

    It can tell the others by messages.
    """
    return SensingTrack.OBJECT if any(find_object_source(specs) for specs in sensors) else SensingTrack.SENSOR


def join_sensing_tracks(tracks: Iterable[str]) -> TrackName:
    """Return the track of several episodes: `object` if any is; unknown ("") if any is or there are none; `sensor`."""
    found = set(tracks)
    if SensingTrack.OBJECT in found:
        return "object"
    return "sensor" if found == {SensingTrack.SENSOR} else ""
