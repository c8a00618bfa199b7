"""Detections that are computed later, or not at all, are those that are computed in their tick."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from testing.worlds import straight_road

from mdrive_sumo.contract import Objects, SensorSpec
from mdrive_sumo.core.state import MOTION_AND_SIZE, Kind
from mdrive_sumo.scenario.weather import WEATHERS
from mdrive_sumo.sensing.objects_sensor import ObjectsSensor
from mdrive_sumo.sensing.sensing_frame import SensingFrame, SensorPose, SensorSetup

HERE = SensorPose(0.0, 0.0, 0.0, 0)


def frame(tick: int) -> SensingFrame:
    """The carrier at the origin, and three cars of which two move."""
    x, y = np.array([(0.0, 0.0), (10.0 + tick, 0.0), (0.0, 30.0), (-25.0, -tick)]).T
    kind = np.full(4, Kind.VEHICLE, dtype=np.uint8)
    yaw, speed, length, width = np.zeros(4), np.full(4, 5.0), np.full(4, 4.6), np.full(4, 1.9)
    return SensingFrame(tick, Objects(("me", "a", "b", "c"), kind, x, y, yaw, speed, length, width), {})


def build_sensor(profile: str) -> ObjectsSensor:
    spec = SensorSpec("objects", options={"profile": profile, "free_space": True})
    return ObjectsSensor(spec, SensorSetup("me", 1, straight_road(), WEATHERS["default"], None))


@given(
    ticks=st.sets(st.integers(0, 40), min_size=1, max_size=12).map(sorted),
    read=st.sets(st.integers(0, 40)),
    profile=st.sampled_from(("ideal", "lidar-single")),
)
def test_what_is_read_does_not_depend_on_what_else_is_read(ticks: list[int], read: set[int], profile: str) -> None:
    """One sensor computes in every tick, the other only what is read, and only at the end."""
    always, lazy = build_sensor(profile), build_sensor(profile)
    computed = [always.sense(frame(tick), HERE) for tick in ticks]
    deferred = [lazy.defer(frame(tick), HERE) for tick in ticks]
    for tick, one, compute in zip(ticks, computed, deferred, strict=True):
        if tick in read:
            later = compute()
            assert later.ids == one.ids
            for column in (*MOTION_AND_SIZE, "kind", "free_m"):
                assert getattr(later, column).tobytes() == getattr(one, column).tobytes()
