"""Lattices for the speeds of roads: exact starts, bounded accelerations, nothing blocked is entered."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.sampling import examples

from mdrive_sumo.planning.parameters import AVOIDANCE, DETOUR, MARGINS, PLANNER, RIGHT_OF_WAY
from mdrive_sumo.planning.planning_scale import PlanningScale
from mdrive_sumo.planning.profile_search import find_fastest_profile
from mdrive_sumo.planning.reference_path import PATH, PathState, ReferencePath, build_path
from mdrive_sumo.planning.speed_lattice import FINE, SAMPLE_S, choose_lattice
from mdrive_sumo.planning.speed_profile import build_braking_profile, build_free_road_problem

WAY = np.column_stack((np.arange(301.0), np.zeros(301)))
TOPS = (13.89, 16.67, 22.22, 33.33)


def way() -> ReferencePath:
    return build_path(WAY, 1.42)


@pytest.mark.parametrize("top", [2.0, 8.0, 9.0, 10.0])
def test_the_speeds_of_the_protocol_have_the_parameters_of_the_protocol(top: float) -> None:
    scale = PlanningScale(top)
    assert scale.lattice is FINE
    assert (scale.right_of_way, scale.detour, scale.avoidance) == (RIGHT_OF_WAY, DETOUR, AVOIDANCE)
    assert (scale.plan_margin, scale.path, scale.replan_ticks) == (MARGINS.plan, PATH, PLANNER.replan_ticks)
    assert (scale.check_s, scale.max_tracking_error_m(8.0)) == (PLANNER.check_s, PLANNER.max_tracking_error_m)


@given(top=st.floats(10.001, 40.0))
def test_the_top_speed_lies_on_its_lattice(top: float) -> None:
    lattice = choose_lattice(top)
    assert lattice.top_speed == pytest.approx(top)
    assert lattice.speed_step <= 2.0
    assert lattice.cell_m == pytest.approx(lattice.speed_step * lattice.step_s / 2)
    assert lattice.samples * SAMPLE_S == lattice.step_s
    states = (lattice.top + 1) * 10.0 * top / lattice.cell_m * 10.0 / lattice.step_s * len(lattice.moves)
    fine = (FINE.top + 1) * 400 * 20 * len(FINE.moves)
    assert states < 3.7 * fine  # in a search over 10 s


@pytest.mark.slow
@settings(max_examples=examples(8, 60), deadline=None)
@given(top=st.sampled_from(TOPS), share=st.floats(0.0, 1.0), wall=st.floats(20.0, 280.0), opens=st.floats(0.0, 12.0))
def test_profiles_are_continuous_and_never_enter_what_is_blocked(
    top: float, share: float, wall: float, opens: float
) -> None:
    path, speed = way(), share * top
    lattice = choose_lattice(top)
    task = build_free_road_problem(path, np.full(len(path.xy), top), PathState(0.0, speed), 0.0, 40.0, lattice)
    ahead = task.lattice_s + np.arange(len(task.cells)) * lattice.cell_m
    blocked = np.zeros_like(task.blocked)
    blocked[np.ix_(task.times < opens, (ahead >= wall) & (ahead < wall + 8.0))] = True
    profile = find_fastest_profile(replace(task, blocked=blocked))
    if profile is None:
        assert wall < speed * speed / (2 * 6.0) + 2 * speed * lattice.step_s / 2 + 5.0
        return
    assert (profile.s[0], profile.speed[0]) == (0.0, speed)
    assert np.diff(profile.s) == pytest.approx((profile.speed[1:] + profile.speed[:-1]) / 2 * lattice.step_s, abs=1e-9)
    change = np.diff(profile.speed) / lattice.step_s
    slack = lattice.speed_step / 2 / lattice.step_s  # of the first step, which leads onto the lattice
    assert np.all((change <= 2.0 + slack + 1e-9) & (change >= -6.0 - slack - 1e-9))
    times = np.arange(SAMPLE_S, (len(profile.s) - 1) * lattice.step_s, SAMPLE_S)
    s = profile.get_stations(times)
    inside = (s > wall + lattice.cell_m) & (s < wall + 8.0 - lattice.cell_m)
    assert not (inside & (times < opens - SAMPLE_S)).any()
    assert profile.reaches_goal


def test_a_profile_that_ends_on_the_way_can_stop_before_what_stays_there() -> None:
    path, lattice = way(), choose_lattice(33.33)
    task = build_free_road_problem(path, np.full(len(path.xy), 33.33), PathState(0.0, 30.0), 0.0, 4.0, lattice)
    hasty = find_fastest_profile(task)
    assert hasty is not None and hasty.s[-1] > 120.0
    after = np.arange(len(task.cells)) * lattice.cell_m > 160.0
    careful = find_fastest_profile(replace(task, blocked_after=after))
    assert careful is not None
    assert careful.s[-1] + careful.speed[-1] ** 2 / (2 * 4.0) < 162.0
    assert find_fastest_profile(replace(task, blocked_after=np.ones(len(task.cells), dtype=np.bool_))) is None


def test_emergency_braking_starts_at_the_own_speed() -> None:
    path, lattice = way(), choose_lattice(33.33)
    task = build_free_road_problem(path, np.full(len(path.xy), 33.33), PathState(0.0, 25.0), 0.0, 4.0, lattice)
    halt = build_braking_profile(task)
    assert (halt.speed[0], halt.speed[-1]) == (25.0, 0.0)
    assert halt.s[-1] < 25.0**2 / (2 * 5.0)


def test_a_search_that_is_stuck_ends_early_with_the_same_place() -> None:
    path, lattice = way(), choose_lattice(16.67)
    task = build_free_road_problem(path, np.full(len(path.xy), 16.67), PathState(0.0, 10.0), 0.0, 60.0, lattice)
    blocked = np.zeros_like(task.blocked)
    blocked[:, 400:] = True
    found = find_fastest_profile(replace(task, blocked=blocked))
    assert found is not None and not found.reaches_goal
    assert len(found.s) < 0.6 * len(task.must_move)
    assert found.s[-1] == pytest.approx(399 * lattice.cell_m, abs=1.0)
    assert found.speed[-1] == 0.0
