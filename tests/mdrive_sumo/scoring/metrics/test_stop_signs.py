"""Stop signs (protocol 7.7): the line is at x = 50 (200 m lanes begin at x = -50), after a box of 6 m."""

from collections.abc import Sequence

import pytest
from testing.score_golden import (
    Row,
    arriving,
    lane,
    roads,
    street,
    turned,
)
from testing.scored_records import Events, events, move_aside, record

from mdrive_sumo.core.state import End
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.network_file import StopSignBox

SIGN = StopSignBox(id="stop", lane="east", line_pos_m=100.0, length_m=6.0)


def stopping(at: float, speed: float) -> list[Row]:
    """A drive to the goal, at `speed` in the tick at x = at."""
    return [(x, y, yaw, speed if x == at else v) for x, y, yaw, v in arriving()]


def stop_events(rows: Sequence[Row], sign: StopSignBox = SIGN, on: RoadMap | None = None) -> Events:
    return events(record(rows, on=on or street(signs=[sign]), end=End.ARRIVED))


def test_a_stop_sign_run_over() -> None:
    """x = 50 (tick 100) is the last place in the box: the sign is left, and counted, in tick 101."""
    found = record(arriving(), End.ARRIVED, on=street(signs=[SIGN]))
    assert [(i.kind, i.tick, i.factor, i.other) for i in found.infractions] == [("stop-sign", 101, 0.8, "stop")]


@pytest.mark.parametrize(("at", "kept"), [(45.0, True), (50.0, True), (24.5, True), (24.0, False), (51.0, False)])
def test_standing_counts_within_reach(at: float, kept: bool) -> None:
    """Points 20 m ahead reach the box from x = 24 on; from the tick after (x = 24.5) the CAV's speed is watched."""
    assert (stop_events(stopping(at, 0.0)) == []) is kept


@pytest.mark.parametrize(("speed", "kept"), [(0.099, True), (0.1, False), (-0.099, True)])
def test_standing_is_below_a_tenth_of_a_metre_per_second(speed: float, kept: bool) -> None:
    assert (stop_events(stopping(48.0, speed)) == []) is kept


def test_a_sign_of_another_lane_does_not_count() -> None:
    assert stop_events(arriving(), StopSignBox(id="stop", lane="west", line_pos_m=100.0, length_m=6.0)) == []


def test_passing_beside_the_box_is_no_infraction() -> None:
    """1.7 m off the centre line of a lane of 3.2 m, with no other lane near."""
    on = roads(lane("east", (-50, 0), (150, 0)), signs=[SIGN])
    assert stop_events(move_aside(arriving(), 40.0, 60.0, -1.5), on=on) == [("stop-sign", 101)]
    assert stop_events(move_aside(arriving(), 40.0, 60.0, -1.7), on=on) == []


def test_unknown_signs_yield_nothing() -> None:
    assert stop_events(arriving(), on=street(signs=None)) == []


def test_reach_goes_on_through_the_lanes_before() -> None:
    """The sign's lane begins at x = 45: at x = 30 the CAV is two lanes before it and 14 m before the box."""
    on = roads(
        lane("a", (-50, 0), (40, 0), successors=("b",)),
        lane("b", (40, 0), (45, 0), successors=("c",)),
        lane("c", (45, 0), (150, 0)),
        signs=[StopSignBox(id="stop", lane="c", line_pos_m=5.0, length_m=6.0)],
    )
    assert stop_events(stopping(30.0, 0.0), on=on) == []
    assert stop_events(stopping(20.0, 0.0), on=on) == [("stop-sign", 101)]


def test_a_cav_against_its_lane_meets_no_sign() -> None:
    rows = [(x, y, turned(95), v) for x, y, _, v in arriving()]
    assert stop_events(rows) == []


def test_two_signs_one_after_the_other() -> None:
    second = StopSignBox(id="next", lane="east", line_pos_m=140.0, length_m=6.0)
    assert stop_events(arriving(), on=street(signs=[SIGN, second])) == [
        ("stop-sign", 101),
        ("stop-sign", 181),
    ]
