"""The nearest trajectory of bounded jerk: within its bounds, near, and the log itself where that is within them."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdrive_sumo.core.geometry import Float
from real2sim.tracks.bounded_trajectory import TrajectoryBounds, fit_bounded_trajectory
from real2sim.tracks.kinematics import acceleration_magnitudes, jerk_magnitudes

DT = 0.1
T = np.arange(60) * DT
FREE = np.zeros(59, dtype=np.bool_)


def line(x: Float) -> Float:
    return np.column_stack((x, np.zeros(len(x))))


def way(speed: Float) -> Float:
    return np.concatenate(((0.0,), np.cumsum(speed[:-1]) * DT))


def test_what_is_within_the_bounds_stays() -> None:
    xy = line(8 * T + 0.5 * T**2)
    assert np.abs(fit_bounded_trajectory(xy, TrajectoryBounds(4.6, 5.7, FREE), DT) - xy).max() < 1e-3


@settings(max_examples=15, deadline=None)
@given(sigma=st.floats(0.0, 0.3), before=st.floats(3, 15), after=st.floats(3, 15), seed=st.integers(0, 99))
def test_bounds_hold_whatever_the_log_does(sigma: float, before: float, after: float, seed: int) -> None:
    noise = np.random.default_rng(seed).normal(0, sigma, (60, 2))
    xy = line(way(np.where(T < 3, before, after))) + noise
    result = fit_bounded_trajectory(xy, TrajectoryBounds(4.6, 5.7, FREE), DT)
    assert jerk_magnitudes(result, DT).max() <= 4.6 * 1.03
    assert acceleration_magnitudes(result, DT).max() <= 5.7 * 1.03


def test_no_trajectory_within_the_bounds_is_nearer() -> None:
    """Any mixture with another one that keeps the bounds is further from the log: the problem is convex."""
    xy = line(way(np.where(T < 3, 12.0, 6.0)))
    best = fit_bounded_trajectory(xy, TrajectoryBounds(4.6, 5.7, FREE), DT)
    for other in (line(9 * T), best + line(0.2 * np.sin(T)), best + 0.05):
        mixed = 0.9 * best + 0.1 * other
        assert ((mixed - xy) ** 2).sum() > ((best - xy) ** 2).sum() - 1e-3


def test_it_brakes_into_standing_and_never_backs() -> None:
    xy = line(way(np.maximum(6.6 - 13 * np.maximum(T - 3, 0), 0.0)))
    still = FREE.copy()
    still[45:] = True
    result = fit_bounded_trajectory(xy, TrajectoryBounds(4.6, 5.7, still, np.zeros(59)), DT)
    assert np.abs(np.diff(result[45:], axis=0)).max() < 3e-3
    assert np.diff(result[:, 0]).min() > -3e-3
    assert np.percentile(np.hypot(*(result - xy).T), 95) < 1.0


@pytest.mark.parametrize("frames", [1, 3, 7])
def test_too_short_to_have_a_jerk_is_left(frames: int) -> None:
    xy = np.random.default_rng(0).normal(0, 1, (frames, 2))
    assert (
        fit_bounded_trajectory(xy, TrajectoryBounds(4.6, 5.7, np.zeros(frames - 1, dtype=np.bool_)), DT) == xy
    ).all()
