"""The highest plausible speed depends on the road, not on the actor itself."""

import numpy as np
import pytest

from mdrive_sumo.core.geometry import Float
from real2sim.quality.actor_quality import HIGHEST_MPS, TOWN_MPS, find_plausible_speeds
from real2sim.quality.reconstruction_quality import ReconstructedLog, assess_reconstruction
from real2sim.recording import ObjectCategory, RecordedTrack

DT = 0.1
T: Float = np.arange(60, dtype=np.float64) * DT


def cruise(id_: str, speed: float) -> RecordedTrack:
    full = np.ones(len(T))
    return RecordedTrack(id_, ObjectCategory.CAR, full > 0, speed * T, 0.0 * T, 0.0 * T, 4.5 * full, 1.8 * full)


@pytest.mark.parametrize(
    ("others", "limit", "expected"),
    [
        ([], None, TOWN_MPS),
        ([40.0] * 4, None, TOWN_MPS),  # too few to tell
        ([40.0] * 5, None, 60.0),
        ([12.0] * 9, None, TOWN_MPS),
        ([], 130 / 3.6, 1.5 * 130 / 3.6),
        ([60.0] * 9, None, HIGHEST_MPS),
        ([12.0] * 4 + [200.0] * 2, None, TOWN_MPS),  # the median: outliers do not set it
    ],
)
def test_the_limit_of_the_road_or_the_traffic_around_sets_it(
    others: list[float], limit: float | None, expected: float
) -> None:
    speeds = {"a": 65.0} | {f"b{k}": speed for k, speed in enumerate(others)}
    found = find_plausible_speeds(speeds, {} if limit is None else {"a": limit})
    assert found["a"] == pytest.approx(expected)


def test_an_autobahn_passes_and_a_racer_in_a_town_does_not() -> None:
    def failing(speeds: list[float], limits: dict[str, float]) -> set[str]:
        tracks = [cruise(str(k), speed) for k, speed in enumerate(speeds)]
        log = ReconstructedLog("log", DT, tracks, {one.id: one for one in tracks}, limits=limits)
        return {actor.id for actor in assess_reconstruction(log).actors if "speed_max" in actor.failed}

    assert failing([33.0, 36.0, 38.0, 41.0, 45.0, 52.0], {}) == set()
    assert failing([45.0], {"0": 36.1}) == set()
    assert failing([10.0, 11.0, 12.0, 13.0, 14.0, 31.0], {}) == {"5"}
    assert failing([45.0], {"0": 13.9}) == {"0"}
