"""Comfort: share of time within nuPlan's bounds, for motions whose derivatives are known."""

import math

import pytest
from testing.score_golden import Row, episode, scenario

from mdrive_sumo.core.state import End
from mdrive_sumo.scoring.metrics.comfort import compute_comfort

TICKS = 200


def comfort(rows: list[Row]) -> float | None:
    return compute_comfort(episode(scenario(), {"0": rows}, {"0": End.TIMED_OUT}))


def accelerating(rate: float) -> list[Row]:
    """Speed [m/s] grows by `rate` [m/s2]."""
    return [(0.0, 0.0, 0.0, 10.0 + rate * tick / 20) for tick in range(TICKS)]


def turning(speed: float, yaw_rate: float) -> list[Row]:
    """Constant yaw rate [rad/s], across the border of angles."""
    return [(0.0, 0.0, math.remainder(3.0 + yaw_rate * tick / 20, math.tau), speed) for tick in range(TICKS)]


@pytest.mark.parametrize(("rate", "expected"), [(2.3, 100.0), (2.5, 0.0), (-1.0, 100.0), (-4.0, 100.0), (-4.2, 0.0)])
def test_longitudinal_acceleration(rate: float, expected: float) -> None:
    assert comfort(accelerating(rate)) == expected


@pytest.mark.parametrize(
    ("speed", "yaw_rate", "expected"),
    [(10.0, 0.45, 100.0), (10.0, 0.52, 0.0), (10.0, -0.52, 0.0), (1.0, 0.90, 100.0), (1.0, -1.0, 0.0)],
)
def test_lateral_acceleration_and_yaw_rate(speed: float, yaw_rate: float, expected: float) -> None:
    """4.5 and 5.2 m/s2 at 10 m/s; at 1 m/s only the yaw rate is out of bounds."""
    assert comfort(turning(speed, yaw_rate)) == expected


def test_a_sudden_brake_is_a_jerk_for_a_part_of_the_time() -> None:
    """From 0 to -4 m/s2 within a tick: about 4 / 0.75 s = 5.3 m/s3 in the middle of the window, out of 4.13."""
    rows = [(0.0, 0.0, 0.0, 30.0 - 4.0 * max(0, tick - 100) / 20) for tick in range(TICKS)]
    share = comfort(rows)
    assert share is not None
    assert 80.0 < share < 100.0


def test_a_short_life_has_no_second_derivative() -> None:
    assert comfort(accelerating(0.0)[:28]) is None
    assert comfort(accelerating(0.0)[:29]) == 100.0
