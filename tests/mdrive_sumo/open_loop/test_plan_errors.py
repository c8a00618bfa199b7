"""Errors of plans against recorded drives, worked out by hand. Boxes are 4.9 x 2.0 m."""

import math

import numpy as np
import pytest
from testing.score_golden import Row, actor, episode, scenario, straight

from mdrive_sumo.contract import Plan
from mdrive_sumo.core.state import Actors, End
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.open_loop.plan_errors import PlanErrors, compute_plan_errors, sample_plan


def recorded(rows: list[Row] | None = None, around: Actors | None = None) -> EpisodeRecord:
    """A CAV that drives east at 10 m/s for 4 s."""
    return episode(scenario(), {"0": rows or straight(80)}, {"0": End.AGENT_FAILED}, actors=around)


def eastward(speed: float, points: int = 15, interval_s: float = 0.2, y: float = 0.0) -> Plan:
    xs = speed * interval_s * np.arange(1, points + 1)
    return Plan(np.stack((xs, np.full(points, y)), axis=-1), interval_s)


def errors(plan: Plan, around: Actors | None = None) -> PlanErrors:
    found = compute_plan_errors(recorded(around=around), 0, 0, plan)
    assert found is not None
    return found


def test_the_recorded_drive_itself_has_no_error() -> None:
    found = errors(eastward(10.0))
    assert (found.ade, found.fde) == pytest.approx((0.0, 0.0), abs=1e-9)
    assert not (found.near or found.near_mdrive or found.overlaps)


def test_a_slower_plan_lags_by_two_metres_a_second() -> None:
    """0.5 to 3 s at 2 m/s less: 1, 2, ... 6 m; mean 3.5 m."""
    found = errors(eastward(8.0))
    assert (found.ade, found.fde) == pytest.approx((3.5, 6.0))


def test_points_between_those_of_the_plan_are_linear() -> None:
    """Points every second; half a second after the start lies half-way to the first."""
    sampled = sample_plan(Plan(np.array([(4.0, 0.0), (6.0, 2.0), (6.0, 6.0)]), 1.0), (0.0, 0.0))
    assert sampled is not None
    assert sampled.tolist() == [[2, 0], [4, 0], [5, 1], [6, 2], [6, 4], [6, 6]]


def test_short_plans_and_ends_of_drives_have_no_score() -> None:
    assert compute_plan_errors(recorded(), 0, 0, eastward(10.0, points=14)) is None
    assert compute_plan_errors(recorded(), 20, 0, eastward(10.0)) is None
    assert compute_plan_errors(recorded(), 19, 0, eastward(10.0)) is not None


@pytest.mark.parametrize(
    ("x", "speed", "near"),
    [
        (30.0 + 4.9 + 8.9, 0.0, True),  # at 3 s the CAV is at x = 30 with a gap of 8.9 m: 0.89 s at 10 m/s
        (30.0 + 4.9 + 9.1, 0.0, False),
        (36.0, 10.0, False),  # as fast: nothing is approached
        (-8.0, 0.0, False),  # behind
    ],
)
def test_time_to_collision_with_what_is_ahead(x: float, speed: float, near: bool) -> None:
    """Actors of `episode` stay where they are; their speed is what they report."""
    assert errors(eastward(10.0), actor(x, 0.0, 0.0, speed)).near is near


def test_what_is_aside_by_three_and_a_half_metres_does_not_count() -> None:
    assert errors(eastward(10.0), actor(20.0, 3.4)).near
    assert not errors(eastward(10.0), actor(20.0, 3.6)).near


def test_the_rule_of_the_original_counts_whatever_is_in_the_lane_at_any_distance() -> None:
    far = actor(500.0, 0.0)
    assert errors(eastward(10.0), far).near_mdrive and not errors(eastward(10.0), far).near
    assert not errors(eastward(10.0), actor(500.0, 3.6)).near_mdrive


def test_boxes_overlap_at_one_of_the_points_only() -> None:
    """The CAV's box passes x = 12.5 between 1 s (x = 10) and 1.5 s (x = 15), half lengths 2.45 + 0.02 m."""
    assert errors(eastward(10.0), actor(20.0, 0.0)).overlaps
    assert not errors(eastward(10.0), actor(20.0, 2.1)).overlaps
    crossing = actor(20.0, 3.0, math.pi / 2)
    assert errors(eastward(10.0), crossing).overlaps


def test_a_standing_plan_keeps_the_recorded_direction() -> None:
    standing = Plan(np.zeros((15, 2)), 0.2)
    rows = [(0.0, 0.0, math.pi / 2, 0.0)] * 80
    found = compute_plan_errors(recorded(rows, actor(0.0, 3.4)), 0, 0, standing)
    assert found is not None and found.overlaps and found.ade == 0.0
