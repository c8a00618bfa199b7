"""Speed profiles in space and time."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.planning.parameters import MARGINS, PROFILE
from mdrive_sumo.planning.profile_search import find_fastest_profile
from mdrive_sumo.planning.reference_path import SPACING_M, PathState, ReferencePath, build_path
from mdrive_sumo.planning.speed_lattice import FINE, SAMPLE_S
from mdrive_sumo.planning.speed_profile import (
    SpeedProfile,
    SpeedProfileProblem,
    build_braking_profile,
    build_free_road_problem,
)

REAR = 1.42
STRAIGHT = np.column_stack((np.arange(61.0), np.zeros(61)))


def straight_path() -> ReferencePath:
    return build_path(STRAIGHT, REAR)


def free_task(path: ReferencePath, speed: float = 0.0, until_s: float = 30.0) -> SpeedProfileProblem:
    return build_free_road_problem(path, np.full(len(path.xy), 9.0), PathState(0.0, speed), 0.0, until_s)


@pytest.mark.slow
@given(speed=st.floats(0.0, 9.0), wall=st.integers(0, 200), opens=st.floats(0.0, 20.0))
def test_profiles_keep_limits_and_never_enter_what_is_blocked(speed: float, wall: int, opens: float) -> None:
    task = free_task(straight_path(), speed)
    blocked = np.zeros_like(task.blocked)
    blocked[task.times < opens, wall : wall + 20] = True
    profile = find_fastest_profile(replace(task, blocked=blocked))
    if profile is None:
        assert wall * SPACING_M < speed**2 / 8 + 5  # only what lies too near to stop before is hopeless
        return
    change = np.diff(profile.speed) / FINE.step_s
    assert np.all((change >= -4.0) & (change <= 2.0) & (profile.speed[1:] <= 9.0) & (profile.speed[1:] >= 0.0))
    assert np.diff(profile.s) == pytest.approx((profile.speed[1:] + profile.speed[:-1]) / 2 * FINE.step_s)
    times = np.arange(SAMPLE_S, (len(profile.s) - 1) * FINE.step_s, SAMPLE_S)
    row = np.round(times / SAMPLE_S).astype(int) - 1
    inside = (profile.get_stations(times) / SPACING_M > wall + 1) & (
        profile.get_stations(times) / SPACING_M < wall + 18
    )
    assert not (inside & (times < opens))[row < len(blocked)].any()
    assert profile.reaches_goal


def test_a_free_road_is_driven_in_the_least_time() -> None:
    profile = find_fastest_profile(free_task(straight_path()))
    assert profile is not None
    # 2 m/s2 up to 9 m/s takes 4.5 s and 20.25 m; the other 40.75 m take 4.53 s.
    assert (len(profile.s) - 1) * FINE.step_s == pytest.approx(
        4.5 + (60 + PROFILE.beyond_goal_m - 20.25) / 9, abs=FINE.step_s
    )


def test_no_profile_if_every_cell_is_blocked() -> None:
    task = free_task(straight_path(), 8.0)
    assert find_fastest_profile(replace(task, blocked=np.ones_like(task.blocked))) is None
    halt = build_braking_profile(task)
    assert list(halt.speed) == [8.0, 6.0, 4.0, 2.0, 0.0]
    assert halt.s[-1] == pytest.approx(8.0)


def test_a_stop_ends_standing_in_its_window_and_the_rest_goes_on() -> None:
    task = free_task(straight_path(), 5.0)
    part = find_fastest_profile(task.require_stop(30.0, 31.5))
    assert part is not None
    assert part.speed[-1] == 0.0
    assert 30.0 <= part.s[-1] <= 31.5
    part = part.extend_standstill(3)
    rest = find_fastest_profile(task.build_remainder(part))
    assert rest is not None
    whole = part.append(rest)
    assert whole.reaches_goal
    assert np.diff(whole.s).min() >= 0.0
    assert len(whole.s) == len(part.s) + len(rest.s) - 1


def test_a_profile_never_stands_for_thirty_seconds() -> None:
    task = free_task(straight_path(), until_s=60.0)
    blocked = np.zeros_like(task.blocked)
    blocked[task.times < 40.0, 30:] = True
    profile = find_fastest_profile(replace(task, blocked=blocked))
    assert profile is not None
    standing = np.convolve(profile.speed == 0.0, np.ones(int(29 / FINE.step_s)), mode="valid")
    assert standing.max() < int(29 / FINE.step_s)
    assert PROFILE.idle_period_s < 30.0


def test_a_violated_margin_is_forgiven_until_it_is_restored() -> None:
    task = free_task(straight_path())
    violated = np.zeros_like(task.blocked)
    violated[:40, :3] = True
    violated[60:, 0] = True
    eased = task.add_traffic(lambda margin: np.zeros_like(violated) if margin == MARGINS.contact else violated.copy())
    assert not eased.blocked[:40].any()
    assert eased.blocked[60:, 0].all()


def test_profiles_continue_at_their_last_speed() -> None:
    profile = SpeedProfile(np.array([0.0, 0.25, 1.0]), np.array([0.0, 1.0, 2.0]), reaches_goal=True)
    assert profile.get_stations(np.array([0.25, 0.5, 1.0, 3.0])) == pytest.approx([0.0625, 0.25, 1.0, 5.0])
