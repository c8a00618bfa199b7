"""Stop signs and traffic lights on the way, and the drive that minds them."""

from collections.abc import Callable
from dataclasses import replace

import pytest
from testing.planning import briefing, own, seen, things

from mdrive_sumo.contract import Cause, Reason, StopSign, TrafficLight
from mdrive_sumo.planning.ego_planner import EgoPlanner
from mdrive_sumo.planning.parameters import STOP_LINE
from mdrive_sumo.planning.reference_path import build_path
from mdrive_sumo.planning.stop_lines import StopLines, StopPoint, build_stop_lines

LIGHTS = (TrafficLight("L", 50.0),)


def yes(line: float) -> bool:
    return True


def no(line: float) -> bool:
    return False


def list_stations(stops: list[StopPoint]) -> list[float]:
    return [stop.s for stop in stops]


def test_a_stop_sign_counts_until_the_car_has_stopped() -> None:
    lines = StopLines([30.0], ())
    before = [30.0 - STOP_LINE.sign_gap_m]
    assert list_stations(lines.find_stops(10.0, 8.0, {}, yes)) == before
    assert list_stations(lines.find_stops(10.0, 0.0, {}, yes)) == before  # stood, but far away
    assert list_stations(lines.find_stops(28.0, 0.5, {}, yes)) == before  # there, but rolling
    assert lines.find_stops(28.0, 0.0, {}, yes) == []
    assert lines.find_stops(28.5, 2.0, {}, yes) == []  # and it is not minded again


def test_a_passed_stop_sign_is_ignored() -> None:
    assert StopLines([30.0], ()).find_stops(30.1, 8.0, {}, yes) == []


@pytest.mark.parametrize(
    ("letter", "here", "can_stop", "held"),
    [("r", 20.0, no, True), ("R", 20.0, no, True), ("u", 20.0, no, True), ("y", 20.0, yes, True),
     ("Y", 20.0, no, False), ("g", 20.0, yes, False), ("G", 20.0, yes, False), ("r", 50.1, yes, False)],
)  # fmt: skip
def test_lights_by_their_colour(letter: str, here: float, can_stop: Callable[[float], bool], held: bool) -> None:
    found = StopLines([], LIGHTS).find_stops(here, 8.0, {"L": letter}, can_stop)
    gap_m = STOP_LINE.light_gap_m
    assert found == (
        [StopPoint(50.0 - gap_m, Reason(Cause.LIGHT, ("L",), distance_m=50 - gap_m - here))] if held else []
    )


def test_a_light_without_state_is_green() -> None:
    assert StopLines([], LIGHTS).find_stops(20.0, 8.0, {}, yes) == []


def test_stop_lines_are_converted_to_the_path_and_signs_can_be_excluded() -> None:
    about = replace(briefing(), stop_signs=(StopSign(30.0),), traffic_lights=LIGHTS)
    path = build_path(about.route_xy, about.vehicle.rear_to_centre, 0.0)
    red = {"L": "r"}
    both = build_stop_lines(path, about).find_stops(0.0, 8.0, red, yes)
    assert list_stations(both) == pytest.approx([28.5, 47.0], abs=0.3)
    assert [stop.reason.cause for stop in both] == [Cause.STOP_SIGN, Cause.LIGHT]
    lights = build_stop_lines(path, about, include_signs=False).find_stops(0.0, 8.0, red, yes)
    assert list_stations(lights) == pytest.approx([47.0], abs=0.3)


@pytest.mark.parametrize(("letter", "x", "stops"), [("r", 20.0, True), ("g", 20.0, False), ("y", 20.0, True),
                                                     ("y", 42.0, False)])  # fmt: skip
def test_a_drive_stops_at_red_and_at_yellow_only_if_it_still_can(letter: str, x: float, stops: bool) -> None:
    drive = EgoPlanner(replace(briefing(), traffic_lights=LIGHTS), own(x, speed=8.0), 8.0)
    now = replace(seen(0, own(x, speed=8.0), things()), signals={"L": letter})
    drive.planner.s = x
    assert drive.track_ego(now)
    drive.update_plan(now, things())
    end = float(drive.planner.get_planned_points(0)[-1, 0])
    assert end < 50.0 - STOP_LINE.light_gap_m + 0.3 if stops else end > 60.0
