"""Intentions, conflict graphs, the common view, and the rule that settles who goes first."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.negotiation_fakes import crossing, member, talk

from mdrive_sumo.contract import Message
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.negotiation import NegotiationMember, RuleNegotiator
from mdrive_sumo.negotiation.conflict_graph import (
    build_conflict_graph,
    build_trajectory_graph,
    compute_free_distance,
    compute_safety,
)
from mdrive_sumo.negotiation.intention import (
    build_line,
    classify_acceleration,
    classify_direction,
    convert_to_acceleration,
    predict_trajectory,
    replace_slow_keep,
)
from mdrive_sumo.negotiation.peer_table import MEMORY_TICKS, PeerTable
from mdrive_sumo.negotiation.right_of_way_claims import NegotiationTerms, build_mcm_message, collect_claims
from mdrive_sumo.negotiation.rule_negotiator import apply_rule, find_leader_pairs, select_winner
from mdrive_sumo.planning.precedence import order_by_urgency
from mdrive_sumo.v2x.messages import Direction, Intention, Mcm, ReferencePose, decode

STRAIGHT = np.array(((0.0, 0.0), (100.0, 0.0)))


@pytest.mark.parametrize(
    ("intention", "nearest", "vehicles", "expected"),
    [
        (Intention.STOP, math.inf, 0, -10.0),
        (Intention.STOP, 5.0, 19, -10.0),
        (Intention.KEEP, 20.0, 3, 0.0),
        (Intention.SLOWER, 50.0, 0, -1.0),
        (Intention.SLOWER, 5.0, 19, -8.0),
        (Intention.FASTER, 50.0, 0, 5.0),
        (Intention.FASTER, 5.0, 19, 1.0),
        (Intention.FASTER, 27.5, 0, 4.0),  # (3 by distance + 5 by number) / 2
        (Intention.FASTER, 50.0, 9, (5 + 1 / (1 / 5 + (1 - 1 / 5) * 9 / 19)) / 2),
    ],
)
def test_intentions_mean_the_documented_accelerations(
    intention: Intention, nearest: float, vehicles: int, expected: float
) -> None:
    assert convert_to_acceleration(intention, nearest, vehicles) == pytest.approx(expected)


@pytest.mark.parametrize(
    ("value", "label"),
    [(-4.1, Intention.STOP), (-4.0, Intention.SLOWER), (-0.6, Intention.SLOWER), (-0.5, Intention.KEEP),
     (0.5, Intention.KEEP), (0.6, Intention.FASTER)],
)  # fmt: skip
def test_labels_of_accelerations(value: float, label: Intention) -> None:
    assert classify_acceleration(value) == label


def test_trajectories_keep_speeds_within_0_and_8() -> None:
    faster = predict_trajectory(STRAIGHT, 6.0, 5.0)
    assert faster.shape == (20, 2)
    assert faster[0] == pytest.approx((6 * 0.2 + 5 * 0.02, 0.0))
    assert np.diff(faster[:, 0])[5:] == pytest.approx(8 * 0.2)  # 8 m/s after 0.4 s
    stopping = predict_trajectory(STRAIGHT, 6.0, -10.0)
    assert stopping[-1] == pytest.approx((1.8, 0.0))  # v^2 / 2 a
    assert predict_trajectory(STRAIGHT, 12.0, 0.0)[0, 0] == pytest.approx(1.6)


def test_trajectories_go_straight_on_beyond_their_way() -> None:
    bend = np.array(((0.0, 0.0), (3.0, 0.0), (3.0, 2.0), (3.0, 2.0)))
    points = predict_trajectory(bend, 5.0, 0.0)
    assert points[2] == pytest.approx((3.0, 0.0))
    assert points[-1] == pytest.approx((3.0, 17.0))


@settings(max_examples=50)
@given(st.floats(0, 8), st.floats(-10, 5), st.floats(-3, 3))
def test_trajectories_never_reverse_nor_exceed_8(speed: float, accelerating: float, yaw: float) -> None:
    way = np.array(((0.0, 0.0), (40 * math.cos(yaw), 40 * math.sin(yaw))))
    gone = predict_trajectory(way, speed, accelerating) @ (math.cos(yaw), math.sin(yaw))
    steps = np.diff(np.concatenate(((0.0,), gone)))
    assert (steps > -1e-9).all() and (steps < 8 * 0.2 + 1e-9).all()


def test_keeping_a_low_speed_becomes_going_faster() -> None:
    assert replace_slow_keep(Intention.KEEP, 3.9) == Intention.FASTER
    assert replace_slow_keep(Intention.KEEP, 4.0) == Intention.KEEP
    assert replace_slow_keep(Intention.SLOWER, 1.0) == Intention.SLOWER


def test_a_standing_car_would_go_straight_on() -> None:
    standing = np.zeros((20, 2))
    assert build_line(0.0, 0.0, math.pi / 2, standing)[-1] == pytest.approx((0.0, 1.0))


S = np.arange(0.0, 31.0)
LANE_CHANGE = 1.75 * (1 + np.tanh((S - 15) / 3))


@pytest.mark.parametrize(
    ("x", "y", "direction"),
    [
        (S, 0 * S, Direction.FOLLOW),
        (np.sin(S / 20) * 20, 20 - np.cos(S / 20) * 20, Direction.LEFT),
        (np.sin(S / 20) * 20, np.cos(S / 20) * 20 - 20, Direction.RIGHT),
        (S, LANE_CHANGE, Direction.CHANGE_LEFT),
        (S, -LANE_CHANGE, Direction.CHANGE_RIGHT),
    ],
)
def test_directions_by_the_shape_of_the_way(x: Float, y: Float, direction: Direction) -> None:
    assert classify_direction(np.column_stack((x, y))) == direction


def test_safety_is_the_protocols() -> None:
    assert compute_safety(3.0) == 0.5
    assert compute_safety(3.549) < 0.75 < compute_safety(3.55)
    assert compute_safety(3.42) < 0.7 < compute_safety(3.43)
    assert compute_safety(1e6) == 1.0 and compute_safety(0.0) == pytest.approx(0.00247, abs=1e-4)


def test_edges_need_the_same_place_at_the_same_time() -> None:
    same_place_later = {"a": member("a", -10, 0, 0.0), "b": member("b", 0, -16, math.pi / 2)}
    together = crossing(10, 12)
    assert build_conflict_graph(list(together.values())).find_group("a") == ("a", "b")
    assert build_conflict_graph(list(same_place_later.values())).find_group("a") == ()


def test_parallel_cars_in_lanes_3_6_m_apart_are_no_conflict_and_3_5_m_apart_are() -> None:
    for gap, group in ((3.6, ()), (3.5, ("a", "b"))):
        assert build_conflict_graph([member("a", 0, 0, 0.0), member("b", 0, gap, 0.0)]).find_group("a") == group


def test_groups_are_connected_components() -> None:
    cars = [member("a", 0, 0, 0), member("b", 0, 3, 0), member("c", 0, 6, 0), member("d", 0, 20, 0)]
    graph = build_conflict_graph(cars)
    assert graph.find_group("c") == ("a", "b", "c")
    assert graph.find_group("d") == ()
    assert graph.find_opponents("a") == {"b"}


def test_time_of_conflict_is_4_ticks_a_step() -> None:
    graph = build_conflict_graph([member("a", -6, 0, 0.0, 5.0), member("b", 0, -6, math.pi / 2, 5.0)])
    assert graph.step[0, 1] == 5  # 1.2 s
    assert graph.count_conflict_ticks(("a", "b")) == 24
    assert graph.get_distance_to_conflict("a") == pytest.approx(5.0)  # from its first point, 1 m ahead, to the middle


def test_who_is_nearer_to_the_crossing_enters_it_first() -> None:
    graph = build_conflict_graph(list(crossing(12, 10).values()))
    assert graph.get_distance_to_conflict("a") == pytest.approx(
        graph.get_distance_to_conflict("b")
    )  # the protocol's measure cannot tell
    assert graph.get_entry_time("b") < graph.get_entry_time("a") < np.inf
    assert build_conflict_graph([member("a", 0, 0, 0)]).get_entry_time("a") == np.inf


def test_a_lone_car_is_1000_m_from_its_conflict() -> None:
    assert build_conflict_graph([member("a", 0, 0, 0)]).get_distance_to_conflict("a") == 1000.0
    assert build_trajectory_graph((), {}).ids == ()


def test_the_room_before_those_who_go_first() -> None:
    a, b = crossing(10, 20).values()
    far = member("c", 0, 50, math.pi / 2)
    assert compute_free_distance(a, [b, far]) == pytest.approx(7.2)  # the sixth point, 2.8 m before the crossing
    assert compute_free_distance(b, [a]) == pytest.approx(16.8)
    assert compute_free_distance(a, [far]) == compute_free_distance(a, []) == math.inf
    assert compute_free_distance(a, [a]) == 0.0


def announced(car: NegotiationMember, tick: int, terms: NegotiationTerms | None = None) -> Message:
    return build_mcm_message(car, tick, terms or NegotiationTerms())


def test_the_view_makes_up_for_age() -> None:
    roster = PeerTable()
    roster.receive(announced(member("a", 0, 0, 0.0, 6.0), 0))
    (seen,) = roster.predict_members(10)
    assert (seen.x, seen.speed) == (pytest.approx(3.0, abs=0.02), pytest.approx(6.0, abs=0.1))
    assert seen.desired.shape == (20, 2)
    assert seen.desired[0, 0] == pytest.approx(4.2, abs=0.02)
    assert seen.desired[-1, 0] == pytest.approx(27.0, abs=0.05)  # beyond the end: at the last speed


def test_a_car_that_waits_still_desires_the_same() -> None:
    standing = member("a", 0, 0, 0.0, 0.0, accelerating=2.0)
    waits = replace(standing, planned=np.zeros((20, 2)))
    roster = PeerTable()
    roster.receive(announced(waits, 0))
    (seen,) = roster.predict_members(20)
    assert seen.desired == pytest.approx(standing.desired, abs=0.02)
    assert seen.planned == pytest.approx(np.zeros((20, 2)), abs=0.01)
    assert seen.speed == 0.0


def test_who_is_silent_for_more_than_a_second_is_forgotten() -> None:
    roster = PeerTable()
    roster.receive(announced(member("a", 0, 0, 0.0), 5))
    assert len(roster.predict_members(5 + MEMORY_TICKS)) == 1
    assert roster.predict_members(6 + MEMORY_TICKS) == ()


def test_an_older_message_that_comes_later_changes_nothing_and_garbage_is_ignored() -> None:
    roster = PeerTable()
    roster.receive(announced(member("a", 10, 0, 0.0), 8))
    roster.receive(announced(member("a", 0, 0, 0.0), 4))
    assert not roster.receive(Message("mcm", b"\x03junk", "z", 8))
    assert not roster.receive(Message("cam", b"", "z", 8))
    assert [(m.id, round(m.x)) for m in roster.predict_members(8)] == [("a", 10)]


def claim(name: str, over: dict[str, Intention], until: int) -> Mcm:
    return Mcm(
        ReferencePose(0, 0, 0, 0),
        0,
        Intention.KEEP,
        Direction.FOLLOW,
        0.2,
        np.zeros((0, 2)),
        requests=over,
        until_tick=until,
    )


def test_claims_are_requests_that_still_hold_and_contradictions_go_to_the_smaller_station() -> None:
    heard = {
        "a": claim("a", {"b": Intention.STOP, "a": Intention.FASTER}, 50),
        "b": claim("b", {"a": Intention.STOP, "c": Intention.SLOWER}, 50),
        "c": claim("c", {"a": Intention.STOP}, 49),
        "d": claim("d", {"a": Intention.FASTER}, 99),
    }
    assert collect_claims(heard, 50) == {("a", "b"), ("b", "c")}


def test_order_keeps_to_claims_and_urgency_is_inherited() -> None:
    urgency = {"a": 1.0, "b": 2.0, "c": 3.0}
    assert order_by_urgency(("a", "b", "c"), urgency, frozenset()) == ("a", "b", "c")
    assert order_by_urgency(("a", "b", "c"), urgency, frozenset({("c", "a")})) == ("c", "a", "b")
    assert sorted(order_by_urgency(("a", "b"), urgency, frozenset({("a", "b"), ("b", "a")}))) == ["a", "b"]


def test_who_is_in_front_goes_first() -> None:
    cars = [member("back", 0, 0, 0.0, 8.0), member("front", 8, 0, 0.0, 2.0), member("oncoming", 12, 0, math.pi)]
    assert find_leader_pairs(cars) == {("front", "back")}


def test_the_nearest_to_the_conflict_goes_and_ties_go_to_the_smaller_station() -> None:
    cars = [member("a", -12, 0, 0.0, 6.0), member("b", 0, -8, math.pi / 2, 4.0)]
    graph = build_conflict_graph(cars)
    assert select_winner(("a", "b"), graph) == "b"
    assert select_winner(("a", "b"), graph, frozenset({("a", "b")})) == "a"  # it has been settled before
    even = build_conflict_graph([member("b", 0, -10, math.pi / 2), member("a", -10, 0, 0.0)])
    assert select_winner(("b", "a"), even) == "a"


@pytest.mark.parametrize(("speed", "action"), [(6.0, Intention.KEEP), (3.0, Intention.FASTER)])
def test_the_winner_keeps_its_intention_but_no_low_speed(speed: float, action: Intention) -> None:
    cars = [member("a", -10, 0, 0.0, speed), member("b", 0, -10, math.pi / 2, speed)]
    actions = apply_rule(cars, build_conflict_graph(cars), ("a", "b"))
    assert actions == {"a": action, "b": Intention.STOP}


def test_all_come_to_the_same_decision_and_say_so() -> None:
    steps = talk(crossing(), {"a": RuleNegotiator(), "b": RuleNegotiator()}, 9)
    a, b = steps[8]["a"].decision, steps[8]["b"].decision
    assert a is not None and b is not None
    assert (a.intention, a.priority_over, a.yield_to) == (Intention.KEEP, {"b"}, frozenset())
    assert (b.intention, b.priority_over, b.yield_to) == (Intention.STOP, frozenset(), {"a"})
    assert a.group == b.group == ("a", "b") and a.until_tick == b.until_tick
    graph = build_conflict_graph(list(crossing().values()))
    assert a.until_tick == pytest.approx(8 + graph.count_conflict_ticks(("a", "b")) + 20, abs=4)
    said = decode(steps[8]["a"].messages[0])
    assert isinstance(said, Mcm)
    assert said.requests == {"a": Intention.KEEP, "b": Intention.STOP}
    answered = decode(steps[8]["b"].messages[0])
    assert isinstance(answered, Mcm) and answered.answers == {"a": True}


def test_manoeuvre_messages_come_every_4_ticks() -> None:
    steps = talk(crossing(), {"a": RuleNegotiator(), "b": RuleNegotiator()}, 12)
    assert [tick for tick in steps if steps[tick]["a"].messages] == [0, 4, 8]


def test_who_claimed_first_stays_first_when_the_other_gets_nearer() -> None:
    negotiators = {"a": RuleNegotiator(), "b": RuleNegotiator()}
    cars = crossing(10, 11)
    talk(cars, negotiators, 8)
    cars |= crossing(10, 9)
    steps = talk(cars, negotiators, 9, first=8)
    assert steps[16]["a"].decision is not None and steps[16]["a"].decision.priority_over == {"b"}
    assert steps[16]["b"].decision is not None and steps[16]["b"].decision.intention == Intention.STOP


def test_a_decision_ends_with_its_validity() -> None:
    negotiator = RuleNegotiator()
    cars = crossing()
    talk(cars, {"a": negotiator, "b": RuleNegotiator()}, 9)
    decision = negotiator.step(9, cars["a"], ()).decision
    assert decision is not None
    assert negotiator.step(decision.until_tick + 41, cars["a"], ()).decision is None


def test_contradicting_claims_are_settled_for_the_smaller_station() -> None:
    """Each hears nothing of the other at first, and sees another order: both claim, then one gives in."""
    negotiators = {"a": RuleNegotiator(), "b": RuleNegotiator()}
    slow, fast = (5.0, 6.0), (6.0, 5.0)
    views = {
        name: {"a": member("a", -10, 0, 0.0, speeds[0]), "b": member("b", 0, -10, math.pi / 2, speeds[1])}
        for name, speeds in (("a", slow), ("b", fast))
    }
    told: dict[str, list[Message]] = {"a": [], "b": []}
    decisions = []
    for tick in range(17):
        steps = {}
        for name, other in (("a", "b"), ("b", "a")):
            heard = [build_mcm_message(views[name][other], m.tick, _terms(m)) for m in told[name]]
            told[name] = []
            steps[name] = negotiators[name].step(tick, views[name][name], heard)
        for name, other in (("a", "b"), ("b", "a")):
            told[other] += steps[name].messages
        decisions.append([steps[name].decision for name in ("a", "b")])
    early, late = decisions[4], decisions[-1]
    assert all(d is not None and d.priority_over for d in early)
    assert late[0] is not None and late[0].priority_over == {"b"}
    assert late[1] is not None and late[1].yield_to == {"a"}


def _terms(message: Message) -> NegotiationTerms:
    mcm = decode(message)
    assert isinstance(mcm, Mcm)
    return NegotiationTerms(mcm.requests, mcm.answers, mcm.group, mcm.until_tick)


def test_passing_lines_up_instead_of_stopping() -> None:
    cars = {
        "a": member("a", -10, 0, 0.0),
        "b": member("b", 2, -12, math.pi / 2),
        "c": member("c", -2, 6, -math.pi / 2),
    }
    steps = talk(cars, {name: RuleNegotiator(passing=True) for name in cars}, 9)
    decisions = {name: step.decision for name, step in steps[8].items()}
    a, b, c = (decisions[name] for name in "abc")
    assert a is not None and (a.yield_to, a.priority_over, a.intention) == ({"c"}, {"b"}, Intention.SLOWER)
    assert b is not None and (b.yield_to, b.priority_over, b.intention) == ({"a"}, frozenset(), Intention.SLOWER)
    assert c is not None and (c.yield_to, c.priority_over, c.intention) == (frozenset(), {"a"}, Intention.KEEP)


def test_under_loss_the_latecomer_learns_from_later_messages() -> None:
    steps = talk(
        crossing(),
        {"a": RuleNegotiator(), "b": RuleNegotiator()},
        17,
        lost=lambda sender, receiver, tick: receiver == "b" and tick < 8,
    )
    assert steps[8]["b"].decision is None  # it has heard nothing
    assert steps[16]["b"].decision is not None and steps[16]["b"].decision.yield_to == {"a"}


def test_the_originals_slip_stops_the_first_station_while_others_negotiate() -> None:
    def last(compat: bool) -> Intention:
        cars = crossing()
        negotiators = {name: RuleNegotiator(compat_ego0=compat) for name in "abcd"}
        cars |= {"c": member("c", 300, 0, 0.0), "d": member("d", 300, 90, 0.0)}
        talk(cars, negotiators, 9)
        cars |= {"a": member("a", 20, 0, 0.0), "c": member("c", 300, 0, 0.0), "d": member("d", 300, 3, 0.0)}
        steps = talk(cars, negotiators, 13, first=12)
        decision = steps[24]["a"].decision
        assert decision is not None
        return decision.intention

    assert last(False) == Intention.KEEP
    assert last(True) == Intention.STOP
