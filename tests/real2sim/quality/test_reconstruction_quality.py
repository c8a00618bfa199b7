"""Fidelity checks on trajectories whose figures are known beforehand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.geometry import Float
from real2sim.quality.actor_quality import compute_actor_quality, compute_dtw_distance, position_errors
from real2sim.quality.lane_segment_index import LaneSegmentIndex
from real2sim.quality.reconstruction_quality import (
    CHECKS,
    QualityCheck,
    ReconstructedLog,
    assess_reconstruction,
    with_failed_checks,
)
from real2sim.recording import ObjectCategory, RecordedTrack
from real2sim.tracks import kinematics
from real2sim.tracks.stationary import has_moved
from real2sim.tracks.track_contacts import find_contacts

DT = 0.1
T = np.arange(100) * DT


def track(x: Float, y: Float | float = 0.0, yaw: Float | float = 0.0, **kwargs: object) -> RecordedTrack:
    n = len(x)
    full = {"length": 4.5, "width": 1.8} | {k: v for k, v in kwargs.items() if k in ("length", "width")}
    return RecordedTrack(
        id=str(kwargs.get("id", "a")),
        category=kwargs.get("category", ObjectCategory.CAR),
        valid=np.ones(n, dtype=np.bool_),
        x=np.asarray(x, dtype=np.float64),
        y=np.broadcast_to(np.asarray(y, dtype=np.float64), n).copy(),
        yaw=np.broadcast_to(np.asarray(yaw, dtype=np.float64), n).copy(),
        length=np.full(n, float(full["length"])),
        width=np.full(n, float(full["width"])),
    )


def circle(radius: float, speed: float) -> RecordedTrack:
    angle = speed / radius * T
    return track(radius * np.sin(angle), radius * (1 - np.cos(angle)), angle)


CRUISE = track(10 * T)


@given(j=st.floats(-8, 8), a=st.floats(-3, 3), v=st.floats(0, 20))
def test_derivatives_are_exact_for_constant_jerk(j: float, a: float, v: float) -> None:
    x = v * T + a * T**2 / 2 + j * T**3 / 6
    xy = np.column_stack((x, np.zeros_like(x)))
    middle = T[3:-3]
    assert np.allclose(kinematics.compute_derivative(xy, DT, 1)[:, 0], v + a * middle + j * middle**2 / 2, atol=1e-6)
    assert np.allclose(kinematics.acceleration_magnitudes(xy, DT), np.abs(a + j * middle), atol=1e-6)
    assert np.allclose(kinematics.jerk_magnitudes(xy, DT), abs(j), atol=1e-5)


def test_jerk_of_noise_is_as_documented() -> None:
    noise = np.random.default_rng(1).normal(0, 0.01, (20_000, 2))
    third = kinematics.compute_derivative(noise, DT, 3)[:, 0]
    plain = np.diff(noise[:, 0], n=3) / DT**3
    assert 3.5 < third.std() < 4.5
    assert 40 < plain.std() < 50


def test_circle_has_the_textbook_acceleration_and_jerk() -> None:
    actor = compute_actor_quality(circle(20.0, 8.0), DT)
    assert actor.acceleration_max == pytest.approx(8**2 / 20, rel=0.01)
    assert actor.jerk_p95 == pytest.approx(8**3 / 20**2, rel=0.01)
    assert actor.yaw_step_max_deg == pytest.approx(math.degrees(0.04), rel=1e-6)
    assert actor.yaw_second_max_deg == pytest.approx(math.degrees(0.4), rel=1e-6)
    assert actor.curvature_spread == pytest.approx(0.0, abs=1e-9)
    assert actor.backward_max < 1e-3


def test_clean_cruise_fails_nothing() -> None:
    assert with_failed_checks(compute_actor_quality(CRUISE, DT, CRUISE)).failed == ()


@pytest.mark.parametrize("size", [0.4, 0.6, 1.2, 2.5])
def test_a_jump_is_counted_with_its_size(size: float) -> None:
    jumped = track(10 * T + size * (T >= 5.0))
    actor = compute_actor_quality(jumped, DT)
    assert actor.jump_max == pytest.approx(size, abs=1e-9)
    assert (actor.jumps_05m, actor.jumps_1m, actor.jumps_2m) == (size > 0.5, size > 1, size > 2)


def test_fast_driving_and_hard_braking_are_no_jumps() -> None:
    braking = np.where(T < 5, 25 * T, 125 + 25 * (T - 5) - 4 * (T - 5) ** 2)
    assert compute_actor_quality(track(np.minimum.accumulate(braking[::-1])[::-1]), DT).jumps_05m == 0


PLANTED: dict[str, RecordedTrack] = {
    "jumps_1m": track(10 * T + 1.5 * (T >= 5)),
    "acceleration_max": track(10 * T + np.where(T > 5, 3.5 * (T - 5) ** 2, 0.0)),
    "speed_max": track(31 * T),
    "yaw_step_max_deg": track(10 * T, 0.0, np.where(T == 5.0, math.radians(12), 0.0)),
    "yaw_second_max_deg": track(np.zeros(100) + 10 * T, 0.0, np.clip((T - 4) * math.radians(80), 0, math.radians(80))),
    "backward_max": track(10 * T, 0.0, math.pi),
    "jerk_p95": track(10 * T + 2.0 * np.sin(2 * T)),
    "curvature_spread": track(6 * T, 0.1 * np.sin(8 * T)),
}


@pytest.mark.parametrize("name", sorted(PLANTED))
def test_every_kinematic_check_finds_its_fault(name: str) -> None:
    assert name in with_failed_checks(compute_actor_quality(PLANTED[name], DT)).failed


ERRORS = {
    "error_median": track(10 * T + 0.35),
    "error_p95": track(10 * T + 1.1 * (T >= 9)),
    "lateral_shift_max": track(10 * T, 2.1 * (T >= 9.85)),
    "dtw_mean": track(10 * T, 0.52),
    "turn_change_deg": track(10 * T, np.maximum(T - 9, 0) * 12),
}


ASTRAY = {
    "lateral_mean": track(10 * T, 1.9),
    "off_route_frames": track(10 * T, -3.1 * (T >= 9.85)),
    "wrong_way_frames": track(10 * T, 0.0, math.pi),
}


@pytest.mark.parametrize("name", sorted(ASTRAY))
def test_every_check_against_the_lanes_finds_its_fault(name: str) -> None:
    one = LaneSegmentIndex.from_centre_lines([np.array(((-50.0, 0.0), (150.0, 0.0)))], [True])
    thing = ASTRAY[name]
    backwards = replace(thing, x=thing.x[::-1].copy()) if name == "wrong_way_frames" else thing
    log = backwards if name == "wrong_way_frames" else CRUISE
    assert name in with_failed_checks(compute_actor_quality(backwards, DT, log, one)).failed
    assert name not in with_failed_checks(compute_actor_quality(CRUISE, DT, CRUISE, one)).failed


def test_every_check_has_a_trajectory_that_fails_it() -> None:
    assert {check.figure for check in CHECKS} == PLANTED.keys() | ERRORS.keys() | ASTRAY.keys()


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.figure)
def test_a_figure_at_its_limit_passes_and_above_it_fails(check: QualityCheck) -> None:
    actor = compute_actor_quality(CRUISE, DT, CRUISE)
    at, above = (actor.model_copy(update={check.figure: check.limit + more}) for more in (0, 1e-6 + (check.limit == 0)))
    assert check.figure not in with_failed_checks(at).failed
    assert check.figure in with_failed_checks(above).failed


@pytest.mark.parametrize("name", sorted(ERRORS))
def test_every_check_against_the_raw_track_finds_its_fault(name: str) -> None:
    assert name in with_failed_checks(compute_actor_quality(ERRORS[name], DT, CRUISE)).failed


def test_errors_are_distances_at_common_frames() -> None:
    gone = CRUISE.valid.copy()
    gone[10:] = False
    assert np.allclose(position_errors(track(10 * T + 3, 4.0), replace(CRUISE, valid=gone)), np.full(10, 5.0))


def test_dtw_forgives_lateness_but_no_other_path() -> None:
    path = np.column_stack((10 * T, np.zeros(100)))
    late = np.column_stack((10 * np.maximum(T - 0.2, 0), np.zeros(100)))
    assert compute_dtw_distance(path, path) == 0.0
    assert compute_dtw_distance(path, late) < 0.1 * np.abs(path - late).sum()
    assert compute_dtw_distance(path, path + np.array((0.0, 1.0))) == pytest.approx(100.0)


@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=1, max_size=5), st.integers(0, 99))
def test_dtw_is_the_textbook_recursion(points: list[tuple[float, float]], seed: int) -> None:
    a = np.array(points)
    b = np.random.default_rng(seed).uniform(-9, 9, a.shape)
    best = np.full((len(a) + 1, len(a) + 1), np.inf)
    best[0, 0] = 0
    for i in range(len(a)):
        for j in range(len(a)):
            best[i + 1, j + 1] = math.dist(a[i], b[j]) + min(best[i, j], best[i, j + 1], best[i + 1, j])
    assert compute_dtw_distance(a, b) == pytest.approx(best[-1, -1])


def test_collisions_use_the_box_and_not_the_length_of_the_track() -> None:
    """The original counted 888 collisions for 10: its box length had been overwritten by the track's length."""
    other = track(10 * T + 5.0, id="b")
    assert find_contacts([CRUISE, other]).collisions == ()
    assert find_contacts([CRUISE, other]).least_distance_m == pytest.approx(0.5)
    assert find_contacts([CRUISE, other]).close_frames == 100


def test_collisions_are_counted_by_frame_and_orientation_matters() -> None:
    crossing = track(np.full(100, 50.0), 10 * T - 50, math.pi / 2, id="b")
    ((first, second, frames),) = find_contacts([CRUISE, crossing]).collisions
    assert (first, second) == (0, 1)
    assert frames == 7  # |10 t - 50| < 2.25 + 0.9, 1 m a frame
    beside = track(10 * T, 1.9, id="b")
    assert find_contacts([CRUISE, beside]).collisions == ()
    turned = track(10 * T, 1.9, math.pi / 2, id="b")
    assert find_contacts([CRUISE, turned]).collisions == ((0, 1, 100),)


def test_spawn_overlap_and_duplicates() -> None:
    late = replace(track(10 * T + 2.0, id="b"), valid=T >= 5)
    found = find_contacts([CRUISE, late])
    assert found.spawn_overlaps == ((0, 1),)
    assert found.duplicates == ((0, 1),)
    assert find_contacts([CRUISE, replace(late, x=10 * T + 4.0)]).duplicates == ()
    assert find_contacts([CRUISE, replace(late, category=ObjectCategory.PEDESTRIAN)]).duplicates == ()
    assert find_contacts([CRUISE, track(10 * T + 1000)]).least_distance_m > 990


STILL = np.zeros(100)
JITTER = np.random.default_rng(3).normal(0, 0.1, (2, 100))


@pytest.mark.parametrize(
    ("thing", "expected"),
    [
        (track(STILL), False),
        (track(JITTER[0], JITTER[1]), False),
        (track(0.3 * T), True),
        (track(0.05 * T), False),
        (track(0.1 * np.sin(6 * T), category=ObjectCategory.BUS), False),
        (track(np.minimum(T, 1.5), category=ObjectCategory.BUS), True),
        (track(0.2 * np.sin(6 * T), category=ObjectCategory.BUS), False),
    ],
)
def test_static_rules(thing: RecordedTrack, expected: bool) -> None:
    assert has_moved(thing, DT) is expected


def test_assess_tells_moving_static_and_walkers_apart() -> None:
    walker = track(1.2 * T, 30.0, category=ObjectCategory.PEDESTRIAN, id="w")
    tracks = [CRUISE, replace(PLANTED["jumps_1m"], id="j", y=np.full(100, 10.0)), track(STILL, 60.0, id="s"), walker]
    quality = assess_reconstruction(
        ReconstructedLog("log", DT, tracks, {t.id: t for t in tracks}, lost={"x": "left the map"})
    )
    assert (quality.moving_vehicles, quality.moving_passed, quality.static_things, quality.walkers) == (2, 1, 1, 1)
    assert quality.moving_passed_share == 0.5
    assert quality.failures.keys() >= {"jumps_1m"}
    assert (quality.teleports, quality.error_median, quality.lost) == (1, 0.0, {"x": "left the map"})
    assert quality.model_validate_json(quality.model_dump_json()) == quality


def test_nothing_at_all_can_be_assessed() -> None:
    quality = assess_reconstruction(ReconstructedLog("empty", DT, [], {}))
    assert (quality.moving_vehicles, quality.moving_passed_share, quality.collisions) == (0, 1.0, ())


def test_every_threshold_names_its_source() -> None:
    assert len({check.figure for check in CHECKS}) == len(CHECKS)
    assert all(check.source.startswith(("asked", "MDrive", "ours")) for check in CHECKS)


def test_turn_ignores_noise_at_rest() -> None:
    noise = np.random.default_rng(1).normal(0, 0.2, (50, 2))
    path = np.concatenate((noise, np.column_stack((np.linspace(0, 20, 50), np.zeros(50)))))
    assert abs(kinematics.compute_turn(path)) < 0.3
    corner = np.array([(x, 0.0) for x in range(10)] + [(9.0, y) for y in range(1, 10)])
    assert kinematics.compute_turn(corner) == pytest.approx(math.pi / 2)
    assert kinematics.compute_turn(corner[:1]) == 0.0
