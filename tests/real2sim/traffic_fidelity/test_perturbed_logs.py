"""Logs as they might have been: vehicles that are longer, or first seen later, keep the order and their place."""

from dataclasses import replace

import numpy as np
import pytest
from testing.fit_crossing import DT_S, Made, crossing, made, seconds, track

from mdrive_sumo.core.geometry import Bool
from mdrive_sumo.roads import RoadMap
from real2sim.recording import ObjectCategory, RecordedTrack
from real2sim.traffic_fidelity import TrafficFidelity, measure_traffic_fidelity

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return crossing(tmp_path_factory.mktemp("crossing"))


def as_bus(one: RecordedTrack) -> RecordedTrack:
    seen = np.where(one.valid, 1.0, np.nan)
    return replace(one, category=ObjectCategory.BUS, length=12.0 * seen, width=2.55 * seen)


def seen_from(one: RecordedTrack, time_s: float) -> RecordedTrack:
    valid: Bool = one.valid & (seconds() >= time_s - 1e-9)
    kept = np.where(valid, 1.0, np.nan)
    columns = {name: getattr(one, name) * kept for name in ("x", "y", "yaw", "length", "width")}
    return one.replace_columns(valid=valid, **columns)


def crossing_traffic() -> dict[str, RecordedTrack]:
    """A vehicle from the side passes between two from the west; another follows on the second lane."""
    return {
        "first": track("first", 150.0 + 10.0 * seconds(), 0.0),
        "side": track("side", 215.0, -88.0 + 10.0 * seconds()),
        "last": track("last", 95.0 + 10.0 * seconds(), 0.0),
        "beside": track("beside", 85.0 + 10.0 * seconds(), 3.5),
    }


def measured(scene: Made) -> TrafficFidelity:
    return measure_traffic_fidelity(scene.scenario, scene.roads, scene.tracks, scene.fitted.names, DT_S)


@pytest.mark.parametrize("changed", ["first", "side", "last", "beside"])
@pytest.mark.parametrize("time_s", [0.0, 5.6])
@pytest.mark.parametrize("is_bus", [False, True])
def test_order_and_place_do_not_depend_on_one_vehicle(
    roads: RoadMap, changed: str, time_s: float, is_bus: bool
) -> None:
    tracks = crossing_traffic()
    one = seen_from(tracks[changed], time_s)
    tracks[changed] = as_bus(one) if is_bus else one
    found = measured(made(roads, *tracks.values()))
    assert found.order_changed == ()
    assert (found.not_departed, found.left_early) == ((), ())
    worst = [error.worst for error in found.errors if error.worst is not None]
    assert max(worst) < 6.0
