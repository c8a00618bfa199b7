"""What a log says about a driver: never more room than it took, never less ability than SUMO's usual driver."""

import numpy as np
import pytest
from testing.fit_crossing import crossing, made, seconds, track

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import CarFollowing
from real2sim.recording import RecordedTrack


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return crossing(tmp_path_factory.mktemp("crossing"))


def estimate(roads: RoadMap, *tracks: RecordedTrack) -> dict[str, CarFollowing]:
    return {one.id: one.driving for one in made(roads, *tracks).fitted.background.vehicles}


def follow(roads: RoadMap, gap_m: float, speed: float) -> CarFollowing:
    """A driver behind another one, bumper to bumper so far apart, both at that speed."""
    behind = 10.0 + speed * seconds()
    return estimate(roads, track("ahead", behind + 4.5 + gap_m, 0.0), track("me", behind, 0.0))["me"]


@pytest.mark.parametrize(("gap_m", "speed"), [(1.0, 3.0), (2.0, 10.0), (6.0, 10.0), (12.0, 8.0), (30.0, 8.0)])
def test_a_driver_needs_no_more_room_than_it_took(gap_m: float, speed: float, roads: RoadMap) -> None:
    driving = follow(roads, gap_m, speed)
    assert driving.min_gap_m + driving.tau_s * speed <= gap_m + 0.1 or (driving.tau_s, driving.min_gap_m) == (
        0.2,
        gap_m,
    )
    assert 0.3 <= driving.min_gap_m <= 2.5
    assert 0.2 <= driving.tau_s <= 2.0


def test_who_follows_nobody_keeps_the_usual_gaps(roads: RoadMap) -> None:
    usual = (1.0, 2.5)
    alone = estimate(roads, track("me", 20.0 + 8.0 * seconds(), 0.0))["me"]
    assert (alone.tau_s, alone.min_gap_m) == usual
    on_other_lane = track("beside", 26.0 + 8.0 * seconds(), 3.5)
    driving = estimate(roads, track("me", 20.0 + 8.0 * seconds(), 0.0), on_other_lane)
    assert (driving["me"].tau_s, driving["me"].min_gap_m) == usual
    far = estimate(roads, track("me", 8.0 * seconds(), 0.0), track("far", 62.0 + 8.0 * seconds(), 0.0))["me"]
    assert (far.tau_s, far.min_gap_m) == usual


def test_a_standing_queue_tells_the_gap_at_rest_and_no_time_gap(roads: RoadMap) -> None:
    """Both roll at 1 m/s for a second, then stand 1.2 m apart."""
    rolled = np.minimum(seconds(), 1.0)
    me = estimate(roads, track("ahead", 20.0 + 4.5 + 1.2 + rolled, 0.0), track("me", 20.0 + rolled, 0.0))["me"]
    assert (me.min_gap_m, me.tau_s) == (pytest.approx(1.2, abs=0.01), 1.0)


def brake(decel: float) -> Float:
    """Stations of a car that drives 12 m/s for 3 s and then brakes so hard to a stop."""
    braking = np.clip(seconds() - 3.0, 0.0, 12.0 / decel)
    return 20.0 + 12.0 * np.minimum(seconds(), 3.0) + 12.0 * braking - 0.5 * decel * braking * braking


@pytest.mark.parametrize(("decel", "least", "most"), [(2.0, 4.5, 4.5), (6.0, 6.5, 8.0), (12.0, 9.0, 9.0)])
def test_who_braked_hard_can_brake_harder_and_nobody_worse_than_usual(
    decel: float, least: float, most: float, roads: RoadMap
) -> None:
    """A fifth more than in the log, between SUMO's usual 4.5 and 9 m/s2."""
    driving = estimate(roads, track("me", brake(decel), 0.0))["me"]
    assert least <= driving.decel <= most
    assert driving.accel == 2.6
    back = estimate(roads, track("me", 400.0 - brake(decel)[::-1], 0.0))["me"]
    assert min(least, 2.6) <= back.accel <= 8.0
    assert back.decel == 4.5
