"""Estimated own states: their errors, their independence of call order, and what they displace."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.state import DT, EgoState
from mdrive_sumo.sensing.localization import REALISTIC_LOCALIZATION, Errors, OwnStateEstimator
from mdrive_sumo.sensing.sensing_frame import SensorPose

TRUTH = EgoState(10.0, -20.0, 0.7, 8.0, 1.0, 0.2, 0.05)
PARAMETERS = REALISTIC_LOCALIZATION


def errors(seed: int, ticks: int) -> np.ndarray:
    """(ticks, 5) errors of x, y, yaw, speed and yaw rate."""
    estimator = OwnStateEstimator(seed)
    found = [estimator.estimate(tick, TRUTH) for tick in range(ticks)]
    return np.array(
        [(e.x - TRUTH.x, e.y - TRUTH.y, e.yaw - TRUTH.yaw, e.speed - TRUTH.speed, e.yaw_rate - TRUTH.yaw_rate)
         for e in found]
    )  # fmt: skip


@given(st.integers(0, 2**31 - 1), st.permutations(range(12)))
def test_an_estimate_depends_on_seed_and_tick_only(seed: int, order: list[int]) -> None:
    asked, straight = OwnStateEstimator(seed), OwnStateEstimator(seed)
    mixed = {tick: asked.estimate(tick, TRUTH) for tick in order}
    assert mixed == {tick: straight.estimate(tick, TRUTH) for tick in range(12)}


@pytest.mark.slow
def test_errors_have_the_stated_deviations_and_are_stationary() -> None:
    sample = np.array([errors(seed, 40) for seed in range(600)])
    expected = np.array(
        (PARAMETERS.position_sigma, PARAMETERS.position_sigma, PARAMETERS.yaw_sigma, 8.0 * PARAMETERS.speed_share,
         PARAMETERS.yaw_rate_sigma)
    )  # fmt: skip
    for tick in (0, 39):  # 600 samples: the standard error of a deviation is 3 percent
        assert sample[:, tick].std(axis=0) == pytest.approx(expected, rel=0.12)
        assert (np.abs(sample[:, tick].mean(axis=0)) < 4 * expected / math.sqrt(600)).all()


@pytest.mark.slow
def test_position_and_yaw_drift_slowly_and_speed_errors_are_new_in_every_tick() -> None:
    sample = np.concatenate([errors(seed, 400)[None] for seed in range(20)])
    kept = math.exp(-20 * DT / PARAMETERS.correlation_s)
    for column, expected in ((0, kept), (2, kept), (3, 0.0), (4, 0.0)):
        values = sample[:, :, column]
        assert (values[:, 20:] * values[:, :-20]).mean() / (values**2).mean() == pytest.approx(expected, abs=0.05)


def test_a_standing_car_knows_that_it_stands_and_the_sigmas_are_told() -> None:
    estimator = OwnStateEstimator(3)
    still = estimator.estimate(5, EgoState(0.0, 0.0, 0.0, 0.0))
    assert still.speed == 0.0
    told = estimator.describe(estimator.estimate(5, TRUTH))
    assert (told.position_sigma, told.yaw_sigma) == (PARAMETERS.position_sigma, PARAMETERS.yaw_sigma)
    assert told.speed_sigma == pytest.approx(0.08, rel=0.1)
    assert (told.acceleration, told.steer_angle) == (TRUTH.acceleration, TRUTH.steer_angle)


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-3, 3), st.integers(0, 999))
def test_a_displaced_object_is_where_it_was_as_seen_from_the_car(x: float, y: float, yaw: float, seed: int) -> None:
    """Oracle: complex numbers, pose by pose."""
    estimate = OwnStateEstimator(seed).estimate(7, TRUTH)
    eye = SensorPose(TRUTH.x, TRUTH.y, TRUTH.yaw, 0, estimate)
    one = Objects(("t00000001",), np.zeros(1, np.uint8), *(np.array([v]) for v in (x, y, yaw, 3.0, 4.0, 2.0)))
    placed = eye.place_by_estimate(one)
    seen = (complex(x, y) - complex(TRUTH.x, TRUTH.y)) * np.exp(-1j * TRUTH.yaw)
    again = (complex(placed.x[0], placed.y[0]) - complex(estimate.x, estimate.y)) * np.exp(-1j * estimate.yaw)
    assert again == pytest.approx(seen, abs=1e-9)
    assert placed.yaw[0] - estimate.yaw == pytest.approx(yaw - TRUTH.yaw)
    assert (placed.speed[0], placed.length[0]) == (3.0, 4.0)


NUMBERS = st.floats(allow_nan=True, allow_infinity=True)


@given(st.integers(0, 2**31 - 1), st.integers(0, 20), st.builds(EgoState, *[NUMBERS] * 7))
def test_both_texts_estimate_the_same(seed: int, tick: int, truth: EgoState) -> None:
    found = compare_twins("sensing_localization_estimate_state", PARAMETERS, seed, 0.998, [], tick, truth)
    compare_twins("sensing_localization_describe_estimate", PARAMETERS, found)
    compare_twins("sensing_localization_to_own_state", truth)


def test_errors_grow_alike_in_both_texts() -> None:
    errors: list[Errors] = []
    for tick in (3, 1, 9):
        compare_twins("sensing_localization_estimate_state", PARAMETERS, 5, 0.9, errors, tick, TRUTH)
        assert len(errors) == max(tick + 1, 4)
