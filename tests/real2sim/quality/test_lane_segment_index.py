"""Fidelity checks on lanes, on trajectories whose figures are known beforehand."""

import math

import numpy as np
import pytest

from real2sim.quality.actor_quality import compute_actor_quality
from real2sim.quality.lane_segment_index import LaneSegmentIndex
from real2sim.quality.reconstruction_quality import ReconstructedLog, assess_reconstruction, with_failed_checks
from real2sim.recording import ObjectCategory
from tests.real2sim.quality.test_reconstruction_quality import DT, T, track


def lanes() -> LaneSegmentIndex:
    """Two directed lanes 3.5 m apart, eastwards at y = 0, westwards at y = 3.5; one undirected at y = 20."""
    east, west = np.array(((-50.0, 0.0), (150.0, 0.0))), np.array(((150.0, 3.5), (-50.0, 3.5)))
    return LaneSegmentIndex.from_centre_lines(
        [east, west, np.array(((150.0, 20.0), (-50.0, 20.0)))], [True, True, False]
    )


@pytest.mark.parametrize(
    ("y", "lateral", "off", "wrong"),
    [(0, 0, 0, 0), (0.8, 0.8, 0, 0), (3.1, 0.4, 0, 100), (8, 4.5, 100, 0), (20, 0, 0, 0)],
)
def test_lane_figures(y: float, lateral: float, off: int, wrong: int) -> None:
    actor = compute_actor_quality(track(10 * T, y), DT, None, lanes())
    assert actor.lateral_mean == pytest.approx(lateral)
    assert (actor.off_route_frames, actor.wrong_way_frames) == (off, wrong)
    assert ("off_route_frames" in with_failed_checks(actor).failed) == (off > 0)
    assert ("wrong_way_frames" in with_failed_checks(actor).failed) == (wrong > 0)


def test_crossing_lanes_are_no_wrong_way() -> None:
    cross = np.column_stack((np.full(2, 50.0), np.array((50.0, -50.0))))
    index = LaneSegmentIndex.from_centre_lines([np.array(((-50.0, 0.0), (150.0, 0.0))), cross], [True, True])
    assert compute_actor_quality(track(10 * T, 0.3), DT, None, index).wrong_way_frames == 0


@pytest.mark.parametrize(("y", "wrong"), [(0.0, 0), (2.5, 0), (3.2, 0), (3.7, 0), (4.4, 100), (5.2, 100)])
def test_over_the_middle_of_a_wide_road_is_not_yet_against_the_lane(y: float, wrong: int) -> None:
    """Lanes 5.2 m wide: a turn that swings 0.6 m over the middle is still beside its own lane, as in a usual one."""
    east, west = np.array(((-50.0, 0.0), (150.0, 0.0))), np.array(((150.0, 5.2), (-50.0, 5.2)))
    index = LaneSegmentIndex.from_centre_lines([east, west], [True, True], [5.2, 5.2])
    assert compute_actor_quality(track(10 * T, y), DT, None, index).wrong_way_frames == wrong


@pytest.mark.parametrize(("y", "wrong"), [(0.5, 0), (1.6, 0), (1.9, 100), (3.5, 100)])
def test_in_a_lane_that_the_map_lacks_a_vehicle_is_beside_the_oncoming_one_and_not_in_it(y: float, wrong: int) -> None:
    index = LaneSegmentIndex.from_centre_lines([np.array(((150.0, 3.5), (-50.0, 3.5)))], [True])
    assert compute_actor_quality(track(10 * T, y), DT, None, index).wrong_way_frames == wrong


def test_without_lanes_every_place_is_infinitely_far_from_one() -> None:
    assert np.isinf(LaneSegmentIndex.from_centre_lines([], []).offsets(np.zeros((1, 2)))).all()


def test_outside_the_map_is_not_off_route() -> None:
    """Beyond the end of the map, or far from all lanes, no lane can be asked for."""
    index = LaneSegmentIndex.from_centre_lines([np.array(((-50.0, 0.0), (50.0, 0.0)))], [True])
    actor = compute_actor_quality(track(10 * T), DT, None, index)
    assert (actor.outside_frames, actor.off_route_frames) == (48, 0)
    far = compute_actor_quality(track(T, 12.0), DT, None, index)
    assert (far.outside_frames, far.off_route_frames) == (100, None)
    assert with_failed_checks(far).failed == ()


@pytest.mark.parametrize(("log", "outside", "off"), [(0.0, 0, 100), (2.6, 0, 100), (2.8, 100, None), (3.2, 100, None)])
def test_lanes_are_asked_for_where_the_log_is_on_one(log: float, outside: int, off: int | None) -> None:
    """A car in a gateway stays in it; one that the conversion takes off its lane is at fault."""
    index = LaneSegmentIndex.from_centre_lines([np.array(((-50.0, 0.0), (150.0, 0.0)))], [True])
    actor = compute_actor_quality(track(10 * T, 3.2), DT, track(10 * T, log), index)
    assert (actor.outside_frames, actor.off_route_frames) == (outside, off)
    quality = assess_reconstruction(ReconstructedLog("log", DT, [track(10 * T, 3.2)], {"a": track(10 * T, log)}, index))
    assert (quality.off_map != {}) is (outside > 0)


def test_a_car_that_the_log_shows_at_the_kerb_has_no_lane_to_keep() -> None:
    index = LaneSegmentIndex.from_centre_lines([np.array(((-50.0, 0.0), (150.0, 0.0)))], [True])
    kerb = track(10 * T, 2.5)
    assert compute_actor_quality(kerb, DT, kerb, index).lateral_mean is None
    assert compute_actor_quality(kerb, DT, track(10 * T, 1.0), index).lateral_mean == pytest.approx(2.5)


def test_a_wide_lane_is_on_the_route_to_its_edge() -> None:
    line = np.array(((-50.0, 0.0), (200.0, 0.0)))
    assert (
        compute_actor_quality(
            track(10 * T, 4.2), DT, None, LaneSegmentIndex.from_centre_lines([line], [True], [8.0])
        ).off_route_frames
        == 0
    )
    assert (
        compute_actor_quality(
            track(10 * T, 4.2), DT, None, LaneSegmentIndex.from_centre_lines([line], [True])
        ).off_route_frames
        == 100
    )


def test_cyclists_and_walkers_are_not_bound_to_lanes() -> None:
    rider = track(5 * T, 8.0, category=ObjectCategory.BICYCLE, id="b")
    quality = assess_reconstruction(ReconstructedLog("log", DT, [rider], {}, lanes()))
    assert (quality.moving_vehicles, quality.walkers, quality.walkers_passed) == (0, 1, 1)


def test_crossing_an_opposite_lane_is_no_wrong_way_driving() -> None:
    index = LaneSegmentIndex.from_centre_lines([np.array(((200.0, 0.0), (-50.0, 0.0)))], [True])
    slanted = track(40 - 0.2 * T + 0.5 * T, 6 * T - 30, math.radians(85))
    assert compute_actor_quality(slanted, DT, None, index).wrong_way_frames == 0
    along = compute_actor_quality(track(10 * T), DT, None, index)
    assert along.wrong_way_frames == 100


@pytest.mark.parametrize(("degrees", "wrong"), [(25, False), (15, True)])
def test_a_slanting_path_crosses_and_a_swerving_one_drives_the_wrong_way(degrees: float, wrong: bool) -> None:
    """The second of two lanes is crossed over about 10 m; overtaking stays in it for longer."""
    index = LaneSegmentIndex.from_centre_lines([np.array(((200.0, 0.0), (-50.0, 0.0)))], [True])
    angle = math.radians(degrees)
    slanted = track(20 + 4 * T * math.cos(angle), 4 * T * math.sin(angle) - 3.0, angle)
    assert (compute_actor_quality(slanted, DT, None, index).wrong_way_frames != 0) is wrong
    swerve = track(10 * T, 3.0 * np.sin(np.pi * T / 10) - 3.0)
    inside = int((swerve.y > -1.75).sum())  # half a lane: before and after, it is still in its own
    assert compute_actor_quality(swerve, DT, None, index).wrong_way_frames == inside > 50
