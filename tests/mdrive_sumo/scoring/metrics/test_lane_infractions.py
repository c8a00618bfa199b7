"""Driving outside lanes and on a wrong lane (protocol 7.3), with expectations worked out by hand."""

import math
from collections.abc import Sequence

import pytest
from testing.score_golden import (
    WIDTH,
    Row,
    arriving,
    episode,
    lane,
    roads,
    scenario,
    straight,
    street,
    turned,
)
from testing.scored_records import move_aside, record

from mdrive_sumo.core.state import End
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scoring.metrics.ego_track import build_ego_track
from mdrive_sumo.scoring.metrics.lane_infractions import LaneWatch, find_outside_lanes

FAILED = 0.6
"""Factor of the end of these drives: the agent fails."""
ONE_LANE = roads(lane("east", (-50, 0), (150, 0)))


@pytest.mark.parametrize(("y", "outside"), [(2.9, False), (2.901, True), (-2.901, True)])
def test_outside_beyond_half_a_lane_and_1_3_m(y: float, outside: bool) -> None:
    """3.2 / 2 + 1.3 = 2.9 m."""
    about = scenario()
    recorded = episode(about, {"0": straight(3, y=y)}, {"0": End.AGENT_FAILED})
    assert find_outside_lanes(build_ego_track(recorded, about, ONE_LANE, 0)).tolist() == [outside] * 3


def test_the_share_outside_lanes_is_what_it_costs() -> None:
    """Point i is passed at x = i + 0.5, so 20.75 <= x < 40.75 covers points 21 to 40: 20 of 100 m."""
    found = record(move_aside(arriving(), 20.75, 40.75, -4.0), End.ARRIVED, on=ONE_LANE)
    assert [(i.kind, i.tick, i.factor) for i in found.infractions] == [("outside-lanes", 202, 0.8)]


def test_the_share_is_of_the_way_made_not_of_the_route() -> None:
    """82 ticks lead to x = 40.5, so 40 m count; 10 of them, points 31 to 40, are outside."""
    found = record(move_aside(straight(82), 30.75, 50.0, -4.0), on=ONE_LANE)
    assert (found.rc, found.ip) == (40.0, pytest.approx(0.75 * FAILED))


def test_standing_outside_costs_nothing() -> None:
    assert record(straight(20, speed=0.0, y=-4.0), on=ONE_LANE).ip == FAILED


def test_the_way_is_measured_three_points_a_tick() -> None:
    """A leap to x = 8.5 outside passes points 1 to 3, the ticks after it 4 to 6 and 7 to 8: 3 of 8 m are outside."""
    rows = [(0.0, 0.0, 0.0, 9.0), (8.5, -4.0, 0.0, 9.0), (8.5, 0.0, 0.0, 9.0), (8.5, 0.0, 0.0, 9.0)]
    assert record(rows, on=ONE_LANE).ip == pytest.approx((1 - 3 / 8) * FAILED)


def test_places_are_looked_up_for_every_tick() -> None:
    """Driving, standing and driving on: the answers are those of every single place."""
    rows = [*straight(5), *straight(4, speed=0.0, begin=2.0), *straight(70, begin=2.0)]
    rows = move_aside(rows, 28.0, 32.0, WIDTH)
    about = scenario()
    track = build_ego_track(episode(about, {"0": rows}, {"0": End.AGENT_FAILED}), about, street(), 0)
    expected = street().find_nearest_lanes(track.xy)
    assert track.nearest.lane.tolist() == expected.lane.tolist()
    assert track.nearest.distance.tolist() == expected.distance.tolist()
    assert track.nearest.yaw.tolist() == expected.yaw.tolist()


def test_on_the_oncoming_lane_is_on_the_wrong_lane() -> None:
    found = record(move_aside(arriving(), 20.75, 40.75, WIDTH), End.ARRIVED)
    assert [(i.kind, i.factor) for i in found.infractions] == [("outside-lanes", 0.8)]


def wrongs(rows: Sequence[Row], on: RoadMap) -> list[bool]:
    about = scenario()
    recorded = episode(about, {"0": rows}, {"0": End.AGENT_FAILED})
    track = build_ego_track(recorded, about, on, 0)
    return LaneWatch(track.reference).find_wrong_lane(track).tolist()


def test_a_cav_that_starts_on_the_oncoming_lane_is_not_on_a_wrong_lane() -> None:
    """A quirk of the original: no change of lanes, no verdict; moving over to one's own lane makes it wrong."""
    rows = [*straight(3, y=WIDTH), *straight(2, y=0.0, begin=2.0)]
    assert wrongs(rows, street()) == [False] * 3 + [True] * 2


def test_changing_between_two_oncoming_lanes_resets() -> None:
    """A quirk of the original: only a change of direction makes wrong, and any change without one makes right."""
    on = roads(
        lane("east", (-50, 0), (150, 0)),
        lane("near", (150, 3.2), (-50, 3.2)),
        lane("far", (150, 6.4), (-50, 6.4)),
    )
    rows = [straight(1)[0], *straight(2, y=3.2), *straight(2, y=6.4), *straight(1, y=0.0)]
    assert wrongs(rows, on) == [False, True, True, False, False, True]


@pytest.mark.parametrize(
    ("degrees", "wrong"), [(149.0, False), (151.0, True), (180.0, True), (-151.0, True), (-149.0, False)]
)
def test_a_lane_is_wrong_if_its_direction_differs_by_150_degrees(degrees: float, wrong: bool) -> None:
    """The second lane crosses x = 75 at this angle; the first one ends at x = 20."""
    dx, dy = 20 * math.cos(turned(degrees)), 20 * math.sin(turned(degrees))
    on = roads(lane("first", (-50, 0), (20, 0)), lane("second", (75 - dx, -dy), (75 + dx, dy)))
    assert wrongs([(10.0, 0.0, 0.0, 9.0), (75.0, 0.0, 0.0, 9.0)], on) == [False, wrong]


@pytest.mark.parametrize(("degrees", "wrong"), [(119.0, False), (121.0, True), (-121.0, True)])
def test_after_a_junction_the_cavs_own_direction_decides(degrees: float, wrong: bool) -> None:
    on = roads(
        lane("in", (0, 0), (20, 0)),
        lane("cross", (20, 0), (30, 0), junction=True),
        lane("out", (30, 0), (90, 0)),
    )
    rows = [(x, 0.0, turned(yaw), 9.0) for x, yaw in ((10, 0), (25, degrees), (40, degrees), (50, 0))]
    assert wrongs(rows, on) == [False, False, wrong, wrong]


@pytest.mark.parametrize("before", [0.0, 3.2])
def test_in_a_junction_no_lane_is_wrong(before: float) -> None:
    """Neither coming from the lane to the east, which the junction's opposes, nor from the wrong lane."""
    on = roads(
        lane("east", (0, 0), (50, 0)),
        lane("west", (50, 3.2), (0, 3.2)),
        lane("cross", (90, 3.2), (50, 3.2), junction=True),
    )
    rows = [(40.0, 0.0, 0.0, 9.0), (40.0, before, 0.0, 9.0), (60.0, 3.2, 0.0, 9.0)]
    assert wrongs(rows, on) == [False, before > 0, False]
