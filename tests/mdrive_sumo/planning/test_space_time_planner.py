"""The planner of the cooperative baselines: exact in space and time around what is expected."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st
from shapely import Polygon, affinity, box
from testing.planning import LENGTH, WIDTH, briefing, moving, own, standing, stations, straight
from testing.sampling import examples

from mdrive_sumo.contract import Cause, Reason
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.planning.interaction_prediction import compute_queue_gap
from mdrive_sumo.planning.motion_prediction import HORIZON_S, TIMES, PredictedMotion
from mdrive_sumo.planning.parameters import MARGINS, PLANNER
from mdrive_sumo.planning.reference_path import SPACING_M
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner
from mdrive_sumo.planning.stop_lines import StopPoint

MARGIN_M = MARGINS.plan.longitudinal - SPACING_M
"""Every second cell of the path is compared, so that a margin may be one cell less."""
SIGN = Reason(Cause.STOP_SIGN)
AFTER = np.arange(1, PLANNER.plan_points + 1) * PLANNER.interval_s


def planned(
    speed: float,
    motions: Sequence[PredictedMotion] = (),
    barriers: Sequence[StopPoint] = (),
    route: Float | None = None,
) -> SpaceTimePlanner:
    """The plan of a car at the beginning of its way."""
    planner = SpaceTimePlanner(briefing(route), 0.0, 8.0)
    planner.track_ego(0, own(speed=speed))
    planner.update(0, speed, motions, barriers)
    return planner


def speeds(planner: SpaceTimePlanner) -> Float:
    """Mean speed [m/s] in every interval of the plan; the first begins at the car."""
    return np.diff(np.concatenate(((planner.s,), stations(planner)))) / PLANNER.interval_s


def test_on_a_free_road_it_speeds_up_to_the_cruising_speed() -> None:
    found = speeds(planned(0.0))
    assert found[-1] == pytest.approx(8.0)
    assert np.all(np.diff(found) >= -1e-6)


def test_the_plan_stops_before_a_standing_car_with_the_margin() -> None:
    planner = planned(8.0, [standing(30.0, 0.0)])
    gap = 30.0 - LENGTH - stations(planner)[-1]
    assert speeds(planner)[-1] < 1.0
    assert MARGIN_M <= gap < MARGIN_M + 1.0


def test_after_a_prediction_ends_only_standing_objects_block() -> None:
    known = int((TIMES <= 2.0).sum())
    stays = replace(standing(60.0, 0.0), poses=standing(60.0, 0.0).poses[:known])
    gone = replace(stays, stands_at_end=False)
    assert stations(planned(8.0, [gone])) == pytest.approx(stations(planned(8.0)))
    assert stations(planned(8.0, [stays]))[-1] < 60.0 - LENGTH


def test_a_standing_object_beside_the_path_is_passed() -> None:
    aside = WIDTH + MARGINS.plan.lateral + 0.1
    assert stations(planned(8.0, [standing(40.0, aside)]))[-1] > 60
    assert stations(planned(8.0, [standing(40.0, aside - 0.2)]))[-1] < 40


def test_the_plan_passes_behind_a_crossing_car() -> None:
    crossing = moving(30.0, -20.0, math.pi / 2, 5.0)  # on my way from 3.4 to 4.7 s; I would be there after 3.75 s
    planner = planned(8.0, [crossing])
    there = float(AFTER[np.argmax(stations(planner) > 30.0)])
    assert there > 20.0 / 5.0
    assert stations(planner)[-1] > 40.0
    assert float(AFTER[np.argmax(stations(planned(8.0)) > 30.0)]) < 4.0  # free road: no waiting


def test_the_plan_passes_before_a_late_crossing_car() -> None:
    late = moving(30.0, -40.0, math.pi / 2, 5.0)
    assert stations(planned(8.0, [late])) == pytest.approx(stations(planned(8.0)))


def test_a_barrier_holds_until_its_time_and_no_longer() -> None:
    planner = planned(4.0, barriers=[StopPoint(15.0, SIGN, until_s=5.0)])
    s = stations(planner)
    assert s[AFTER <= 5.0].max() < 15.0
    assert s[AFTER <= 7.0].max() > 15.0


def test_the_plan_closes_up_early_to_its_waiting_position() -> None:
    s = stations(planned(4.0, barriers=[StopPoint(20.0, SIGN)]))
    assert s[AFTER <= 4.0].max() > 14.0


def test_a_barrier_without_end_is_never_passed() -> None:
    planner = planned(8.0, barriers=[StopPoint(30.0, SIGN), StopPoint(60.0, SIGN)])
    assert 28.0 < stations(planner)[-1] < 30.0


def test_an_enclosed_car_stands() -> None:
    walls = [standing(LENGTH + 0.5, 0.0), standing(-LENGTH - 0.5, 0.0), standing(0.0, 2.0), standing(0.0, -2.0)]
    assert stations(planned(0.0, walls)) == pytest.approx(0.0, abs=0.3)


def test_a_car_that_cannot_avoid_a_collision_brakes() -> None:
    found = speeds(planned(8.0, [standing(8.0, 0.0)]))
    assert found[-1] == 0
    assert np.all(np.diff(found) <= 1e-6)


def test_a_standing_car_in_a_queue_does_not_follow_the_drift_of_its_estimated_position() -> None:
    ahead = [replace(standing(LENGTH + 1.0, 0.0), min_gap_m=1.1)]
    planner = planned(0.0, ahead)
    for tick in range(2, 200, 2):
        planner.track_ego(tick, own(-0.002 * tick))
        planner.update(tick, 0.0, ahead)
        assert stations(planner, tick)[0] <= planner.s + 0.05


@pytest.mark.slow
@settings(max_examples=examples(6, 100))
@given(
    sigma=st.floats(0.0, 0.25),
    gap_m=st.floats(0.5, 3.0),
    errors=st.lists(st.floats(-3.0, 3.0), min_size=8, max_size=12),
)
@example(sigma=0.25, gap_m=1.5, errors=[3.0] * 12)
def test_the_gap_in_a_queue_stays_positive_whatever_the_errors(sigma: float, gap_m: float, errors: list[float]) -> None:
    """The vehicle ahead stands; every half second its position is estimated anew, off by up to three sigma."""
    planner, x, speed = SpaceTimePlanner(briefing(), 0.0, 8.0), 0.0, 0.0
    front = LENGTH + gap_m
    for tick in range(0, PLANNER.replan_ticks * len(errors), 4):
        error = errors[tick // PLANNER.replan_ticks] * sigma
        ahead = replace(standing(front + error, 0.0), min_gap_m=compute_queue_gap(sigma))
        planner.track_ego(tick, own(x, speed=speed))
        planner.update(tick, speed, [ahead])
        after = max(float(stations(planner, tick)[0]), x)  # 0.2 s later; it does not drive back
        x, speed = after, (after - x) / PLANNER.interval_s
        assert front - LENGTH - x > 0


def test_the_gap_in_a_queue_counts_ahead_and_not_aside() -> None:
    """A car that passes within the margin of a parked one is not stopped by the gap, as long as it does not overlap."""
    for aside, passes in ((WIDTH + 0.5, True), (WIDTH - 0.1, False)):
        parked = replace(standing(10.0, aside), min_gap_m=1.5)
        assert bool(stations(planned(0.0, [parked]))[-1] > 20.0) is passes


def test_after_a_long_wait_the_gap_in_a_queue_does_not_shrink() -> None:
    gap_m = compute_queue_gap(0.2)
    planner = SpaceTimePlanner(briefing(), 0.0, 8.0)
    for tick in range(0, 2 * PLANNER.deadlock_ticks, 4):
        planner.track_ego(tick, own())
        planner.update(tick, 0.0, [replace(standing(LENGTH + gap_m - 0.1, 0.0), min_gap_m=gap_m)])
        assert stations(planner, tick)[-1] == pytest.approx(0.0)


def test_after_a_long_wait_the_margin_shrinks() -> None:
    planner, beside = SpaceTimePlanner(briefing(), 0.0, 8.0), [standing(10.0, WIDTH + 0.25)]
    ends: list[float] = []
    for tick in range(0, 2 * PLANNER.deadlock_ticks, 2):
        planner.track_ego(tick, own())
        planner.update(tick, 0.0, beside)
        ends.append(float(planner.get_planned_points(tick)[-1, 0]))
    assert ends[0] < 10.0 - LENGTH / 2
    assert ends[-1] > 30.0


def test_a_car_that_must_wait_waits_without_limit() -> None:
    """The omniscient planner moves a little every 24 s."""
    plans: list[Float] = []
    for tick in (0, 400):
        planner = SpaceTimePlanner(briefing(), 0.0, 8.0)
        planner.track_ego(tick, own(speed=1.0))
        planner.update(tick, 1.0, [], [StopPoint(6.0, SIGN)])
        plans.append(planner.get_planned_points(tick))
    assert np.array_equal(plans[0], plans[1])


@settings(max_examples=examples(12, 40))
@given(
    speed=st.floats(0.0, 8.0),
    limit=st.sampled_from((4.0, 6.0, 8.0, 13.9)),
    barrier=st.floats(40.0, 80.0),
)
def test_plans_keep_to_limits_and_comfortable_accelerations(speed: float, limit: float, barrier: float) -> None:
    assume(speed <= limit)
    planner = SpaceTimePlanner(briefing(limit=limit), 0.0, 8.0)
    planner.track_ego(0, own(speed=speed))
    planner.update(0, speed, [], [StopPoint(barrier, SIGN)])
    found = speeds(planner)
    assert found.max() <= min(8.0, limit) + 0.5  # the start is rounded to whole m/s
    assert found.min() >= 0
    change = np.diff(found) / PLANNER.interval_s
    assert change.max() <= 2.0 + 1e-6
    assert change.min() >= -4.0 - 1e-6
    assert stations(planner).max() < barrier


def test_bends_are_driven_slowly() -> None:
    bend = np.vstack((straight(20.0), np.column_stack((np.full(30, 20.0), np.arange(1.0, 31.0)))))
    planner = planned(8.0, route=bend)
    way = np.hypot(*np.diff(planner.get_planned_points(0), axis=0).T) / PLANNER.interval_s
    assert way.min() < 5.0
    assert planned(8.0).get_planned_points(0)[-1, 0] > 70


@pytest.mark.slow
@given(st.floats(0.0, 8.0))
def test_what_it_desires_is_a_free_road(speed: float) -> None:
    planner = planned(speed, barriers=[StopPoint(3.0, SIGN)])
    wanted = planner.predict_desired_points(speed, 20)
    found = np.diff(np.concatenate(((0.0,), wanted[:, 0]))) / PLANNER.interval_s
    assert wanted.shape == (20, 2)
    assert found[0] == pytest.approx(min(speed + PLANNER.braking * PLANNER.interval_s / 2, 8.0), abs=0.2)
    assert np.all(np.diff(found) / PLANNER.interval_s <= PLANNER.braking + 1e-6)
    assert found[-1] == pytest.approx(min(8.0, speed + PLANNER.braking * 19.5 * PLANNER.interval_s), abs=0.3)


def test_what_it_desires_slows_down_for_a_lower_limit() -> None:
    planner = SpaceTimePlanner(briefing(limit=4.0), 0.0, 8.0)
    assert np.diff(planner.predict_desired_points(8.0, 20)[:, 0])[-1] == pytest.approx(4.0 * PLANNER.interval_s)


def test_a_car_that_goes_astray_makes_a_new_profile() -> None:
    planner = planned(8.0)
    planner.track_ego(3, own(x=8.0 * 0.15 + 0.7, speed=8.0))
    assert not planner.is_update_due(3)
    planner.track_ego(3, own(x=8.0 * 0.15 + 1.1, speed=8.0))
    assert planner.is_update_due(3)
    planner.update(3, 8.0, [])
    assert planner.get_planned_points(3)[0, 0] == pytest.approx(8.0 * 0.15 + 1.1 + 8.0 * PLANNER.interval_s, abs=0.05)


def test_a_safe_profile_is_kept_and_an_unsafe_one_replaced() -> None:
    planner = planned(8.0)
    before = planner.get_planned_points(4)
    planner.track_ego(4, own(x=1.6, speed=8.0))
    assert planner.is_update_due(4)
    planner.update(4, 8.0, [standing(60.0, 0.0)])  # too far away to be met within 3 s
    assert np.array_equal(planner.get_planned_points(4), before)
    planner.update(4, 8.0, [standing(22.0, 0.0)])
    assert planner.get_planned_points(4)[-1, 0] < 22.0 - LENGTH


def test_plans_are_due_five_times_a_second() -> None:
    planner = planned(8.0)
    due: list[int] = []
    for tick in range(1, 21):
        planner.track_ego(tick, own(x=8.0 * tick * 0.05, speed=8.0))
        if planner.is_update_due(tick):
            due.append(tick)
    assert due == [4, 8, 10, 12, 16, 20]


def footprint(x: float, y: float, yaw: float, length: float, width: float) -> Polygon:
    """A box, made by shapely alone."""
    centred = box(-length / 2, -width / 2, length / 2, width / 2)
    return affinity.translate(affinity.rotate(centred, yaw, origin=(0, 0), use_radians=True), x, y)


@st.composite
def crossers(draw: st.DrawFn) -> PredictedMotion:
    """A car that begins away from my way and crosses it, or stands beside it."""
    at, gap, speed = draw(st.floats(25.0, 70.0)), draw(st.floats(6.0, 40.0)), draw(st.floats(0.0, 10.0))
    angle = math.radians(draw(st.floats(40.0, 140.0))) * draw(st.sampled_from((1, -1)))
    return moving(at - gap * math.cos(angle), -gap * math.sin(angle), angle, speed)


@pytest.mark.slow
@settings(max_examples=examples(15, 60))
@given(speed=st.integers(0, 8), motions=st.lists(crossers(), min_size=1, max_size=4))
def test_a_plan_never_overlaps_a_prediction(speed: int, motions: list[PredictedMotion]) -> None:
    """An independent oracle: polygons of shapely at times that are none of the planner's own."""
    planner = planned(float(speed), motions)
    met: list[float] = []
    for t, x in zip(AFTER, stations(planner), strict=True):
        if t > HORIZON_S - 0.5:
            break
        me = footprint(float(x), 0.0, 0.0, LENGTH, WIDTH)
        for motion in motions:
            x_other, y_other, yaw = (float(np.interp(t, TIMES, column)) for column in motion.poses.T)
            if t >= TIMES[0] and me.intersects(footprint(x_other, y_other, yaw, LENGTH, WIDTH)):
                met.append(float(t))
    assert met == []
