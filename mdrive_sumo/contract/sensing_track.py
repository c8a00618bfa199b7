"""Sensing tracks: whether the CAVs of a run are given lists of objects, or only what a car carries.

A track follows from the sensors that agents declare in an episode, which are all that the evaluator computes for them,
never from what an agent says (docs/decisions/057-sensor-track-and-object-track.md): `sensing.sensor_kinds` derives it.
"""

from collections.abc import Iterable
from enum import StrEnum
from typing import Literal


class SensingTrack(StrEnum):
    """What the CAVs of a run perceive with."""

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
