"""Minimum time to collision of boxes of 4.9 x 2.0 m."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.sampling import examples
from testing.score_golden import (
    actor,
    ego,
    episode,
    scenario,
    straight,
)

from mdrive_sumo.core.geometry import Float, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import End
from mdrive_sumo.scoring.metrics import compute_min_ttc


def ttc(x: float, speed: float, other_speed: float = 0.0, y: float = 0.0, yaw: float = 0.0) -> float | None:
    about = scenario()
    recorded = episode(
        about,
        {"0": [(0.0, 0.0, 0.0, speed)]},
        {"0": End.AGENT_FAILED},
        actors=actor(x, y, yaw, other_speed),
    )
    return compute_min_ttc(recorded)


def test_time_to_the_car_ahead() -> None:
    """A gap of 14.9 - 4.9 = 10 m, closing at 10 m/s."""
    assert ttc(14.9, speed=10.0) == pytest.approx(1.0)
    assert ttc(14.9, speed=15.0, other_speed=5.0) == pytest.approx(1.0)


def test_no_contact_beyond_the_horizon() -> None:
    """17.999 m take just under 1.8 s, 18.001 m just over."""
    assert ttc(22.899, speed=10.0) == pytest.approx(1.7999)
    assert ttc(22.901, speed=10.0) is None


def test_slow_closing_is_left_out() -> None:
    assert ttc(5.4, speed=1.0) == pytest.approx(0.5)
    assert ttc(5.4, speed=0.999) is None


def test_passing_beside_is_no_contact() -> None:
    assert ttc(10.0, speed=10.0, y=2.01) is None


def test_a_crossing_car() -> None:
    """It comes from the right at 10 m/s, centre 20 m ahead and 13.45 m aside: gap 13.45 - 2.45 - 1 = 10 m."""
    assert ttc(20.0, speed=20.0, other_speed=10.0, y=-13.45, yaw=math.pi / 2) == pytest.approx(1.0, abs=2e-3)


def test_a_car_askew_is_met_at_its_own_edge() -> None:
    """At 45 degrees and 3.3 m aside. Along its axis the boxes span 3.45 / √2 + 2.45 m, that is x + y = 6.915 m.

    So they touch at x = 3.615 m, and not at the 4.889 m where their projections on the road's axes first overlap.
    """
    assert ttc(13.615, speed=10.0, y=3.3, yaw=math.pi / 4) == pytest.approx(1.0, abs=2e-4)


def test_the_least_of_all_ticks_and_pairs_counts() -> None:
    about = scenario(ego("0"), ego("1", y=20.0))
    drives = {"0": straight(3), "1": [(14.9 - x, y, math.pi, v) for x, y, _, v in straight(3)]}
    recorded = episode(about, drives, dict.fromkeys(drives, End.AGENT_FAILED))
    assert compute_min_ttc(recorded) == pytest.approx((10.0 - 2 * 1.0) / 20.0, abs=1e-3)


place = st.floats(-25, 25).map(lambda value: round(value, 3))


@settings(max_examples=examples(30, 100), deadline=None)
@given(x=place, y=place, yaw=st.floats(-3, 3), speed=st.floats(0, 20), other=st.floats(0, 20))
def test_time_to_contact_against_moving_the_boxes(x: float, y: float, yaw: float, speed: float, other: float) -> None:
    """The oracle moves both boxes in small steps: 5 cm larger ones meet at that time, smaller ones not before it."""
    found = ttc(x, speed, other, y, yaw)
    closing = speed * x - other * (x * math.cos(yaw) + y * math.sin(yaw))

    def meet(times: Float, larger: float) -> bool:
        length, width = np.full_like(times, 4.9 + larger), np.full_like(times, 2.0 + larger)
        own = boxes_corners(speed * times, 0 * times, 0 * times, length, width)
        ahead = (x + other * times * math.cos(yaw), y + other * times * math.sin(yaw))
        return bool(boxes_overlap(own, boxes_corners(*ahead, np.full_like(times, yaw), length, width)).any())

    if found is not None:
        assert meet(np.array([found]), 0.05)
    elif closing > 1.01 * math.hypot(x, y):
        assert not meet(np.arange(0.0, 1.8, 0.005), -0.05)
    assert found is None or not meet(np.arange(0.0, found, 0.005), -0.05)
