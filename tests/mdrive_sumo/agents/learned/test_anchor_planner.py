"""The planner on forecasts: paces, what it reads of a forecast, and what it does about what is in the way."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.planning import briefing, own, seen, things

from mdrive_sumo.agents.learned.anchor_planner import ANCHORS, AnchorPlanner, build_paces
from mdrive_sumo.agents.learned.fusion_spec import FORECAST_S, OUTPUT_CELLS
from mdrive_sumo.agents.learned.occupancy_grid import OccupancyForecast, draw_boxes, draw_tracks
from mdrive_sumo.contract import Cause, Objects, Plan, Reason
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.planning.reference_path import SPACING_M

NOTHING = things()
POSE: Float = np.zeros(3)


def test_a_box_covers_the_cells_whose_centres_it_holds() -> None:
    """From 10.2 to 13.8 m ahead and from 0.3 m right to 1.7 m left: centres lie at odd multiples of 0.4 m."""
    (drawn,) = draw_boxes(np.array([[(12.0, 0.7, 0.0, 3.6, 2.0)]]))
    rows, columns = np.nonzero(drawn)
    x, y = 51.2 - (np.unique(rows) + 0.5) * 0.8, 51.2 - (np.unique(columns) + 0.5) * 0.8
    assert x == pytest.approx([13.2, 12.4, 11.6, 10.8]) and y == pytest.approx([1.2, 0.4])
    assert len(rows) == 8


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-4, 4), st.floats(0.2, 18), st.floats(0.2, 3))
def test_every_box_in_the_grid_is_drawn_and_nothing_far_from_it(
    x: float, y: float, yaw: float, length: float, width: float
) -> None:
    (drawn,) = draw_boxes(np.array([[(x, y, yaw, length, width)]]))
    rows, columns = np.nonzero(drawn)
    gaps = np.hypot(51.2 - (rows + 0.5) * 0.8 - x, 51.2 - (columns + 0.5) * 0.8 - y)
    assert len(gaps) > 0 and gaps.max() <= math.hypot(max(length, 1.15), max(width, 1.15)) / 2 + 1e-9


def test_a_forecast_tells_places_and_times_in_the_world() -> None:
    occupied = np.zeros((len(FORECAST_S), OUTPUT_CELLS, OUTPUT_CELLS), np.float32)
    occupied[2] = draw_boxes(np.array([[(10.0, 0.0, 0.0, 4.0, 2.0)]]))[0]  # ahead at 1 s
    forecast = OccupancyForecast(20, np.array((100.0, 50.0, math.pi / 2)), occupied)  # looks along y
    times: Float = np.array((0.3, 0.6, 0.8, 1.2, 1.6))
    there = np.full((5, 1, 2), (100.0, 60.0))
    assert forecast.look_up(there, times, 20).ravel().tolist() == [0.0, 1.0, 1.0, 1.0, 0.0]
    assert forecast.look_up(there, times, 28).ravel().tolist() == [1.0, 1.0, 1.0, 0.0, 0.0]  # 0.4 s later
    assert not forecast.look_up(np.full((5, 1, 2), (110.0, 50.0)), times, 20).any()
    assert not forecast.look_up(np.full((5, 1, 2), (1e6, 0.0)), times, 20).any()


@given(st.floats(0, 20), st.floats(1, 15), st.floats(0, 60))
def test_paces_keep_to_limits_or_brake_as_hard_as_they_can(speed: float, limit: float, begin: float) -> None:
    limits = np.full(800, limit)
    limits[400:] = limit / 2
    paces = build_paces(begin, speed, limits)
    assert (np.diff(paces.stations, axis=1) >= 0).all() and (paces.speeds >= 0).all()
    bound = limits[(paces.stations[:, :-1] / SPACING_M).astype(int)]
    slowed = paces.speeds[:, :-1] - ANCHORS.step_s * ANCHORS.hardest_braking
    assert (paces.speeds[:, 1:] <= np.maximum(bound, slowed) + 1e-9).all()


def forecast_of(objects: Objects, tick: int = 0) -> OccupancyForecast:
    return OccupancyForecast(tick, POSE, draw_tracks(objects, own()))


def plan_for(objects: Objects, speed: float, cap: float = 5.0) -> tuple[Plan, Cause]:
    planner = AnchorPlanner(briefing(), cap)
    planner.take_forecast(forecast_of(objects))
    plan, (note,) = planner.plan(seen(2, own(speed=speed), NOTHING), NOTHING)
    reason = Reason.from_note(note)
    assert reason is not None and plan.controller == "v2x-5"
    return plan, reason.cause


def find_way(plan: Plan) -> float:
    return float(plan.points[14, 0])  # after 3 s


def test_on_a_free_road_it_drives_as_fast_as_it_may() -> None:
    plan, cause = plan_for(NOTHING, 5.0)
    assert find_way(plan) == pytest.approx(15.0, abs=0.1) and cause == Cause.FREE
    assert find_way(plan_for(NOTHING, 8.0, math.inf)[0]) == pytest.approx(24.0, abs=0.1)  # the scenario asks for 8 m/s
    assert find_way(plan_for(things((12.0, 8.0, 0.0, 0.0)), 5.0)[0]) == pytest.approx(15.0, abs=0.1)  # beside the road


def test_it_stops_before_what_stands_and_follows_what_drives() -> None:
    stands, cause = plan_for(things((14.0, 0.0, 0.0, 0.0)), 5.0)
    assert 3.0 < find_way(stands) < 14.0 - 4.5 and cause == Cause.NETWORK_BRAKES
    waits, cause = plan_for(things((6.0, 0.0, 0.0, 0.0)), 0.0)
    assert find_way(waits) < 1.0 and cause == Cause.NETWORK_STANDS
    assert find_way(plan_for(things((12.0, 0.0, 0.0, 5.0)), 5.0)[0]) == pytest.approx(15.0, abs=0.1)
    slow = plan_for(things((11.0, 0.0, 0.0, 2.0)), 5.0)[0]
    assert 5.0 < find_way(slow) < 12.0


def test_it_lets_pass_what_crosses_and_goes_where_that_has_been() -> None:
    comes = plan_for(things((12.0, -12.0, math.pi / 2, 5.0)), 5.0)[0]
    assert find_way(comes) < 8.0
    gone = plan_for(things((12.0, 6.0, math.pi / 2, 5.0)), 5.0)[0]
    assert find_way(gone) == pytest.approx(15.0, abs=0.1)


def test_a_standing_car_stays_where_something_will_come_and_its_own_place_is_not_taken() -> None:
    waits = plan_for(things((5.0, -10.0, math.pi / 2, 5.0)), 0.0)[0]
    assert find_way(waits) < 4.0
    alone = plan_for(things((0.0, 0.0, 0.0, 0.0)), 0.0)[0]  # others see the own car
    assert find_way(alone) > 9.0


def test_unlikely_cells_cost_less_than_standing() -> None:
    occupied = np.full((len(FORECAST_S), OUTPUT_CELLS, OUTPUT_CELLS), 0.04, np.float32)
    planner = AnchorPlanner(briefing(), 5.0)
    planner.take_forecast(OccupancyForecast(0, POSE, occupied))
    assert find_way(planner.plan(seen(2, own(speed=5.0), NOTHING), NOTHING)[0]) == pytest.approx(15.0, abs=0.1)


def test_between_forecasts_the_pace_goes_on_from_where_the_car_is() -> None:
    planner = AnchorPlanner(briefing(), 5.0)
    planner.take_forecast(forecast_of(NOTHING))
    first, notes = planner.plan(seen(2, own(speed=0.0), NOTHING), NOTHING)
    later, none = planner.plan(seen(6, own(x=0.3, speed=0.5), NOTHING), NOTHING)
    assert len(notes) == 1 and none == ()
    steps, moved_on = np.diff(first.points[:, 0]), np.diff(later.points[:-1, 0])
    assert moved_on == pytest.approx(steps[1:], abs=1e-6) and later.points[0, 0] - 0.3 == pytest.approx(steps[0])


def test_without_any_forecast_it_drives() -> None:
    planner = AnchorPlanner(briefing(), 5.0)
    plan, _ = planner.plan(seen(0, own(speed=5.0), NOTHING), NOTHING)
    assert find_way(plan) == pytest.approx(15.0, abs=0.1)
