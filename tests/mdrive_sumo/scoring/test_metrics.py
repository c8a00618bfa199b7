"""Each rule of protocol 7 with an expectation worked out on paper. CAVs drive 0.5 m a tick unless said otherwise."""

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.score_golden import (
    NO_HITS,
    WIDTH,
    Hits,
    Row,
    actor,
    arriving,
    ego,
    episode,
    hit,
    lane,
    roads,
    scenario,
    straight,
    street,
    turned,
)

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import End, Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.network_file import StopSignBox
from mdrive_sumo.scoring.metrics import EgoRecord, EpisodeMismatch, build_ego_records, compute_min_ttc
from mdrive_sumo.scoring.metrics.ego_track import build_ego_track
from mdrive_sumo.scoring.metrics.lane_infractions import find_outside_lanes, find_wrong_lane

Events = list[tuple[str, int]]


def record(
    rows: Sequence[Row], end: End = End.AGENT_FAILED, hits: Hits = NO_HITS, on: RoadMap | None = None
) -> EgoRecord:
    """The record of the only CAV of a scenario of 100 m; its agent fails at the end unless said otherwise."""
    about = scenario()
    return build_ego_records(episode(about, {"0": rows}, {"0": end}, hits), about, on or street())[0]


def events(found: EgoRecord) -> Events:
    return [(i.kind, i.tick) for i in found.infractions if i.kind not in ("agent-failed", "route-deviation")]


def test_a_clean_drive_completes_with_nothing() -> None:
    found = record(arriving(), End.ARRIVED)
    assert (found.rc, found.ip, found.infractions) == (100.0, 1.0, ())


def test_completion_of_who_did_not_arrive() -> None:
    """41 ticks: x = 20 at last, and point 19 is the last one passed."""
    assert record(straight(41)).rc == 19.0


# --- collisions


@pytest.mark.parametrize(
    ("kind", "name", "factor"),
    [
        (Kind.PEDESTRIAN, "collision-pedestrian", 0.50),
        (Kind.VEHICLE, "collision-vehicle", 0.60),
        (Kind.CYCLIST, "collision-vehicle", 0.60),
        (Kind.STATIC, "collision-static", 0.65),
    ],
)
def test_a_collision_costs_by_what_was_hit(kind: Kind, name: str, factor: float) -> None:
    found = record(arriving(), End.ARRIVED, {20: [hit("0", "a", kind)]})
    assert [(i.kind, i.tick, i.x, i.y, i.factor, i.other) for i in found.infractions] == [
        (name, 20, 10.0, 0.0, factor, "a")
    ]
    assert (found.rc, found.ip) == (100.0, factor)


def test_both_cavs_of_a_pair_pay() -> None:
    about = scenario(ego("0"), ego("1", y=20.0))
    both = {5: [hit("0", "1"), hit("1", "0")]}
    drives = {"0": arriving(), "1": arriving(y=20.0)}
    on = roads(lane("a", (-50, 0), (150, 0)), lane("b", (-50, 20), (150, 20)))
    found = build_ego_records(episode(about, drives, {"0": End.ARRIVED, "1": End.ARRIVED}, both), about, on)
    assert [(one.ip, one.infractions[0].other) for one in found] == [(0.6, "1"), (0.6, "0")]


def hits_of(*ticks_and_others: tuple[int, str]) -> dict[int, list[object]]:
    return {tick: [hit("0", other)] for tick, other in ticks_and_others}  # pyright: ignore


def collision_ticks(rows: Sequence[Row], *ticks_and_others: tuple[int, str]) -> list[int]:
    return [tick for _, tick in events(record(rows, hits=hits_of(*ticks_and_others)))]  # pyright: ignore


def test_touching_on_is_one_collision() -> None:
    assert collision_ticks(straight(60, speed=0.0), *((tick, "a") for tick in range(10, 60))) == [10]


def test_the_same_actor_counts_again_after_more_than_5_s() -> None:
    """Tick 100 is exactly 5 s after the first hit; the places are 50 m and more apart."""
    assert collision_ticks(straight(180), (0, "a"), (60, "a"), (100, "a"), (101, "a")) == [0, 101]


def test_the_5_s_begin_at_the_counted_hit_not_at_an_ignored_one() -> None:
    assert collision_ticks(straight(180), (0, "a"), (90, "a"), (150, "a")) == [0, 150]


def test_another_actor_counts_more_than_3_m_further() -> None:
    """Tick 6 is 3.0 m, tick 7 3.5 m from the first place."""
    assert collision_ticks(straight(20), (0, "a"), (6, "b")) == [0]
    assert collision_ticks(straight(20), (0, "a"), (7, "b")) == [0, 7]


def test_only_the_last_counted_actor_is_remembered() -> None:
    assert collision_ticks(straight(60), (0, "a"), (10, "b"), (20, "a"), (30, "a")) == [0, 10, 20]


def test_the_map_is_never_the_last_actor() -> None:
    assert collision_ticks(straight(60), (0, ""), (10, ""), (20, "")) == [0, 10, 20]
    assert collision_ticks(straight(60), (0, "a"), (10, ""), (20, "a")) == [0, 10]


@pytest.mark.parametrize(("away", "counted"), [(5.0, [0]), (5.5, [0, 24])])
def test_a_place_is_forgotten_more_than_5_m_away(away: float, counted: list[int]) -> None:
    """Out to `away` m and back to the first place, where b is hit in tick 24."""
    rows = [(away * min(tick, 24 - tick) / 12, 0.0, 0.0, 1.0) for tick in range(25)]
    assert collision_ticks(rows, (0, "a"), (24, "b")) == counted


def test_a_collision_counts_between_completion_and_leaving() -> None:
    found = record(arriving(), End.ARRIVED, {202: [hit("0", "a")]})
    assert (found.rc, events(found)) == (100.0, [("collision-vehicle", 202)])


def test_factors_multiply() -> None:
    hits = {0: [hit("0", "a")], 40: [hit("0", "b", Kind.PEDESTRIAN)], 80: [hit("0", "", Kind.STATIC)]}
    assert record(arriving(), End.ARRIVED, hits).ip == pytest.approx(0.60 * 0.50 * 0.65)


# --- outside lanes, wrong lane


def aside(rows: Sequence[Row], begin: float, end: float, y: float) -> list[Row]:
    """The same drive, moved to y where begin <= x < end."""
    return [(x, y if begin <= x < end else at, yaw, speed) for x, at, yaw, speed in rows]


ONE_LANE = roads(lane("east", (-50, 0), (150, 0)))


@pytest.mark.parametrize(("y", "outside"), [(2.9, False), (2.901, True), (-2.901, True)])
def test_outside_beyond_half_a_lane_and_1_3_m(y: float, outside: bool) -> None:
    """3.2 / 2 + 1.3 = 2.9 m."""
    about = scenario()
    recorded = episode(about, {"0": straight(3, y=y)}, {"0": End.AGENT_FAILED})
    assert find_outside_lanes(build_ego_track(recorded, about, ONE_LANE, 0)).tolist() == [outside] * 3


def test_the_share_outside_lanes_is_what_it_costs() -> None:
    """Point i is passed at x = i + 0.5, so 20.75 <= x < 40.75 covers points 21 to 40: 20 of 100 m."""
    found = record(aside(arriving(), 20.75, 40.75, -4.0), End.ARRIVED, on=ONE_LANE)
    assert [(i.kind, i.tick, i.factor) for i in found.infractions] == [("outside-lanes", 202, 0.8)]


def test_the_share_is_of_the_way_made_not_of_the_route() -> None:
    """82 ticks lead to x = 40.5, so 40 m count; 10 of them, points 31 to 40, are outside."""
    found = record(aside(straight(82), 30.75, 50.0, -4.0), on=ONE_LANE)
    assert (found.rc, found.ip) == (40.0, 0.75)


def test_standing_outside_costs_nothing() -> None:
    assert record(straight(20, speed=0.0, y=-4.0), on=ONE_LANE).ip == 1.0


def test_the_way_is_measured_three_points_a_tick() -> None:
    """A leap to x = 8.5 outside passes points 1 to 3, the ticks after it 4 to 6 and 7 to 8: 3 of 8 m are outside."""
    rows = [(0.0, 0.0, 0.0, 9.0), (8.5, -4.0, 0.0, 9.0), (8.5, 0.0, 0.0, 9.0), (8.5, 0.0, 0.0, 9.0)]
    assert record(rows, on=ONE_LANE).ip == 1 - 3 / 8


def test_places_are_looked_up_for_every_tick() -> None:
    """Driving, standing and driving on: the answers are those of every single place."""
    rows = [*straight(5), *straight(4, speed=0.0, begin=2.0), *straight(70, begin=2.0)]
    rows = aside(rows, 28.0, 32.0, WIDTH)
    about = scenario()
    track = build_ego_track(episode(about, {"0": rows}, {"0": End.AGENT_FAILED}), about, street(), 0)
    expected = street().find_nearest_lanes(track.xy)
    assert track.nearest.lane.tolist() == expected.lane.tolist()
    assert track.nearest.distance.tolist() == expected.distance.tolist()
    assert track.nearest.yaw.tolist() == expected.yaw.tolist()


def test_on_the_oncoming_lane_is_on_the_wrong_lane() -> None:
    found = record(aside(arriving(), 20.75, 40.75, WIDTH), End.ARRIVED)
    assert [(i.kind, i.factor) for i in found.infractions] == [("outside-lanes", 0.8)]


def wrongs(rows: Sequence[Row], on: RoadMap) -> list[bool]:
    about = scenario()
    recorded = episode(about, {"0": rows}, {"0": End.AGENT_FAILED})
    return find_wrong_lane(build_ego_track(recorded, about, on, 0)).tolist()


def test_who_starts_on_the_oncoming_lane_is_not_found_wrong() -> None:
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


# --- stop signs: the line at x = 50 (200 m lanes begin at x = -50), a box of 6 m before it


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
    assert stop_events(aside(arriving(), 40.0, 60.0, -1.5), on=on) == [("stop-sign", 101)]
    assert stop_events(aside(arriving(), 40.0, 60.0, -1.7), on=on) == []


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


# --- red lights: the line at x = 50


def crossing(letters: dict[int, str], signals: str = "program", y: float = 0.0) -> Events:
    on = roads(
        lane("in", (0, 0), (50, 0), successors=("out",), lights={"out": "junction:1"}),
        lane("out", (50, 0), (150, 0)),
        lane("beside", (0, 3.2), (150, 3.2)),
    )
    about = scenario(ego(lanes=("in", "out")), signals=signals)
    states = {tick: {"junction": "r" + letter} for tick, letter in letters.items()}
    recorded = episode(about, {"0": arriving(y=y)}, {"0": End.ARRIVED}, signals=states)
    return events(build_ego_records(recorded, about, on)[0])


@pytest.mark.parametrize(
    ("letter", "red"), [("r", True), ("R", True), ("u", True), ("y", False), ("g", False), ("G", False)]
)
def test_a_red_light_run_over(letter: str, red: bool) -> None:
    """x = 50.5 (tick 101) is the first place beyond the line."""
    assert crossing({0: letter}) == ([("red-light", 101)] if red else [])


def test_the_letter_of_that_very_tick_counts() -> None:
    assert crossing({0: "G", 101: "r"}) == [("red-light", 101)]
    assert crossing({0: "r", 101: "G"}) == []
    assert crossing({0: "G", 102: "r"}) == []


def test_frozen_green_has_no_red_lights() -> None:
    assert crossing({0: "r"}, signals="frozen-green") == []


def test_the_next_lane_is_no_way_around_a_red_light() -> None:
    assert crossing({0: "r"}, y=3.2) == [("red-light", 101)]


def test_a_light_without_a_recorded_state_is_an_error() -> None:
    with pytest.raises(EpisodeMismatch, match="junction"):
        crossing({})


# --- endings


def test_the_end_is_marked_without_a_cost() -> None:
    found = record(straight(602, speed=0.0), End.BLOCKED)
    assert [(i.kind, i.tick, i.factor) for i in found.infractions] == [("blocked", 601, 1.0)]
    assert (found.rc, found.ip, found.ending.end) == (0.0, 1.0, End.BLOCKED)


def test_a_time_out_keeps_the_way_made() -> None:
    """T = 0.8 * 100 + 8 = 88 s; at 1 m/s the CAV is at x = 88 then, and point 87 is the last one passed."""
    found = record(straight(1761, speed=1.0), End.TIMED_OUT)
    assert [(i.kind, i.tick) for i in found.infractions] == [("timed-out", 1760)]
    assert (found.rc, found.ip) == (87.0, 1.0)


def test_a_deviation_ends() -> None:
    rows = [(0.0, 0.0, 0.0, 9.0), (0.0, -30.0, 0.0, 9.0)]
    found = record(rows, End.DEVIATED)
    assert [(i.kind, i.tick) for i in found.infractions] == [("route-deviation", 1)]


def test_an_agents_failure_is_taken_from_the_recording() -> None:
    found = record(straight(5))
    assert [(i.kind, i.tick) for i in found.infractions] == [("agent-failed", 4)]
    assert found.ending.text == "ValueError: no"


@pytest.mark.parametrize(
    ("rows", "end"),
    [
        (straight(5), End.ARRIVED),
        (straight(602, speed=0.0), End.TIMED_OUT),
        (straight(601, speed=0.0), End.BLOCKED),
        (straight(603, speed=0.0), End.BLOCKED),
        (arriving(), End.AGENT_FAILED),
        (arriving()[:-1], End.ARRIVED),
    ],
)
def test_a_recording_that_contradicts_its_frames_is_refused(rows: list[Row], end: End) -> None:
    with pytest.raises(EpisodeMismatch, match="CAV 0"):
        record(rows, end)


def test_an_episode_of_another_scenario_is_refused() -> None:
    recorded = episode(scenario(), {"0": arriving()}, {"0": End.ARRIVED})
    with pytest.raises(InputError, match="expected scenario other"):
        build_ego_records(recorded, scenario(id="other"), street())


# --- least time to collision: boxes of 4.9 x 2.0 m


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


@settings(max_examples=100, deadline=None)
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
