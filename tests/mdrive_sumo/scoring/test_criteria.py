"""Every rule with an expectation that can be worked out on paper: routes are straight, points 1 m apart."""

import math

import numpy as np
import pytest
from testing.score_golden import ego, scenario

from mdrive_sumo.core.state import End
from mdrive_sumo.scoring.criteria import (
    RouteProgress,
    RouteReference,
    build_reference_along,
    compute_completion_percent,
    compute_time_limit_ticks,
    find_end,
    update_progress,
)

NEVER = 10**9


def eastward(length: int = 100, yaw: float = 0.0) -> RouteReference:
    x = np.arange(length + 1.0)
    return build_reference_along(np.column_stack((x, np.zeros_like(x))), np.full_like(x, yaw))


def after(course: RouteReference, *places: tuple[float, float], speed: float = 10.0) -> RouteProgress:
    """The trial of a CAV that was at these places in ticks 0, 1 ..."""
    trial = RouteProgress()
    for tick, (x, y) in enumerate(places):
        trial = update_progress(trial, course, tick, x, y, speed)
    return trial


def test_a_tick_passes_at_most_two_points() -> None:
    course = eastward()
    assert compute_completion_percent(after(course, (50.0, 0.0)), course) == 2.0
    assert compute_completion_percent(after(course, (50.0, 0.0), (50.0, 0.0)), course) == 4.0


def test_a_point_is_passed_only_beyond_it() -> None:
    course = eastward()
    assert after(course, (1.0, 0.0)).passed == 0
    assert after(course, (1.001, 0.0)).passed == 1


def test_passing_needs_no_lateral_nearness() -> None:
    assert after(eastward(), (1.5, 14.0)).passed == 1


def test_passing_asks_the_lane_direction_not_the_way_to_the_next_point() -> None:
    """Lanes that point north along a route to the east, as where a route changes lanes."""
    northward = eastward(yaw=math.pi / 2)
    assert after(northward, (1.5, -0.1)).passed == 0
    assert after(northward, (0.0, 0.5)).passed == 2


def test_a_later_point_may_be_passed_before_an_earlier_one() -> None:
    yaw = np.zeros(101)
    yaw[1] = math.pi
    course = build_reference_along(np.column_stack((np.arange(101.0), np.zeros(101))), yaw)
    assert after(course, (2.5, 0.0)).passed == 2


def test_completion_never_shrinks() -> None:
    course = eastward()
    assert after(course, (1.5, 0.0), (2.5, 0.0), (0.5, 0.0)).passed == 2


def drive(course: RouteReference, to: float, y: float = 0.0) -> RouteProgress:
    return after(course, *((float(x), y) for x in np.arange(0.0, to + 0.01, 0.5)))


def test_completed_beyond_99_percent() -> None:
    """Of 100 m, point 99 makes exactly 99 %, which is not more than 99 %: only point 100 will do."""
    course = eastward()
    nearly, done = drive(course, 100.0), drive(course, 100.5)
    assert (nearly.arrived_tick, compute_completion_percent(nearly, course)) == (None, 99.0)
    assert (done.arrived_tick, compute_completion_percent(done, course)) == (201, 100.0)


def test_a_long_route_is_completed_before_its_last_point() -> None:
    """Of 200 m, point 199 makes 99.5 %; it is passed at 199.5 m, in tick 399, and RC is set to 100."""
    course = eastward(200)
    done = drive(course, 199.5)
    assert (done.passed, done.arrived_tick, compute_completion_percent(done, course)) == (199, 399, 100.0)


@pytest.mark.parametrize(("aside", "arrives"), [(9.98, True), (10.0, False)])
def test_completed_within_10_m_of_the_goal(aside: float, arrives: bool) -> None:
    """At x = 100.5 and y = aside, the goal is hypot(0.5, aside) away: 9.993 and 10.012 m."""
    assert (drive(eastward(), 100.5, aside).arrived_tick is not None) is arrives


@pytest.mark.parametrize(("east", "north"), [(1, 0), (0, 1), (-1, 0), (0.6, -0.8)])
def test_the_goal_is_the_last_point_whichever_way_the_route_leads(east: float, north: float) -> None:
    """Nine metres beyond it a CAV has arrived, eleven metres beyond it has passed it."""
    xy = np.outer(np.arange(101.0), (east, north))
    course = build_reference_along(xy, np.full(101, math.atan2(north, east)))
    for beyond, arrives in ((9.0, True), (11.0, False)):
        trial = RouteProgress(passed=98)
        trial = update_progress(trial, course, 1, (100.0 + beyond) * east, (100.0 + beyond) * north, 10.0)
        assert (trial.arrived_tick is not None) is arrives


def test_arrived_one_tick_later() -> None:
    done = drive(eastward(), 100.5)
    assert find_end(done, 201, NEVER) is None
    assert find_end(done, 202, NEVER) is End.ARRIVED


@pytest.mark.parametrize(
    ("length", "seconds"),
    [(50, 48), (91, 80), (52, 49)],  # 0.8 * 91 + 8 = 80.8; 0.8 * 52 + 8 = 49.6
)
def test_time_limit_of_ego_0(length: int, seconds: int) -> None:
    limits = compute_time_limit_ticks(scenario(ego("0", length), ego("1", 300)))
    assert limits == dict.fromkeys(("0", "1"), seconds * 20)


def test_a_cav_may_have_a_time_limit_of_its_own() -> None:
    timed = ego("1", 300).model_copy(update={"time_limit_s": 12.34})
    written = scenario(ego("0", 50), timed)
    drawn = written.derive(egos=(ego("0", 60), ego("1", 310)))
    assert compute_time_limit_ticks(written) == compute_time_limit_ticks(drawn) == {"0": 48 * 20, "1": 247}


def test_timed_out_at_the_limit() -> None:
    trial = RouteProgress(moving_tick=959)
    assert find_end(trial, 959, 960) is None
    assert find_end(trial, 960, 960) is End.TIMED_OUT


@pytest.mark.parametrize(("reached", "end"), [(959, End.ARRIVED), (960, End.TIMED_OUT)])
def test_a_goal_reached_in_the_tick_in_which_time_runs_out_is_a_time_out(reached: int, end: End) -> None:
    """Completing the route ends a CAV a tick later (protocol 6), the time-out at once (7.6)."""
    assert find_end(RouteProgress(arrived_tick=reached, moving_tick=960), 960, 960) is end
    assert compute_completion_percent(RouteProgress(arrived_tick=reached), eastward()) == 100.0


def standing(speeds: dict[int, float], ticks: int) -> list[int]:
    """Ticks in which a CAV is blocked that stands but for these speeds."""
    course, trial, blocked = eastward(), RouteProgress(), list[int]()
    for tick in range(ticks):
        trial = update_progress(trial, course, tick, 0.0, 0.0, speeds.get(tick, 0.0))
        if find_end(trial, tick, NEVER) is End.BLOCKED:
            blocked.append(tick)
    return blocked


def test_a_cav_that_never_starts_is_blocked_after_more_than_30_s() -> None:
    assert standing({}, 602) == [601]


@pytest.mark.parametrize(("speed", "first"), [(0.5, 701), (-0.5, 701), (0.499, 601)])
def test_half_a_metre_per_second_restarts_the_clock(speed: float, first: int) -> None:
    assert standing({100: speed}, 702)[0] == first


@pytest.mark.parametrize(("aside", "deviates"), [(30.0, True), (29.999, False)])
def test_deviated_30_m_away(aside: float, deviates: bool) -> None:
    trial = after(eastward(), (0.0, aside))
    assert (find_end(trial, 0, NEVER) is End.DEVIATED) is deviates


@pytest.mark.parametrize(("metres", "deviates"), [(30, False), (31, True)])
def test_deviated_over_30_percent_of_the_route_15_m_away(metres: int, deviates: bool) -> None:
    """At y = 15 and x = 0, 1 ... the nearest point is that of x: `metres` of 100 m are off the route."""
    trial = after(eastward(), *((float(x), 15.0) for x in range(metres + 1)))
    assert trial.off_route_m == metres
    assert (find_end(trial, metres, NEVER) is End.DEVIATED) is deviates


def test_under_15_m_away_is_no_deviation() -> None:
    assert after(eastward(), *((float(x), 14.99) for x in range(100))).off_route_m == 0.0


def test_deviation_looks_five_points_ahead() -> None:
    """A leap to x = 40 is 35 m away from the nearest of the points 0 to 5, and one to x = 34 is 29 m away."""
    assert after(eastward(), (0.0, 0.0), (40.0, 0.0)).has_deviated
    assert not after(eastward(), (0.0, 0.0), (34.0, 0.0)).has_deviated
    assert after(eastward(), (0.0, 0.0), (34.0, 0.0)).nearest == 5


def test_of_two_equally_near_points_the_later_counts() -> None:
    assert after(eastward(), (0.5, 0.0)).nearest == 1


def test_of_two_ends_deviation_precedes_blocking_and_blocking_the_time_out() -> None:
    assert find_end(RouteProgress(has_deviated=True), 2000, 1000) is End.DEVIATED
    assert find_end(RouteProgress(), 2000, 1000) is End.BLOCKED
