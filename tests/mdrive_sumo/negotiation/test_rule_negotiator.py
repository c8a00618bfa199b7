"""The peer table, claims, and the rule that decides which CAV goes first."""

import math
from dataclasses import replace

import numpy as np
import pytest
from testing.negotiation_fakes import crossing, member, talk

from mdrive_sumo.contract import Message
from mdrive_sumo.negotiation import NegotiationMember, RuleNegotiator
from mdrive_sumo.negotiation.conflict_graph import (
    build_conflict_graph,
)
from mdrive_sumo.negotiation.peer_table import MEMORY_TICKS, PeerTable
from mdrive_sumo.negotiation.right_of_way_claims import NegotiationTerms, build_mcm_message, collect_claims
from mdrive_sumo.negotiation.rule_negotiator import apply_rule, find_leader_pairs, select_winner
from mdrive_sumo.planning.planning_order import order_by_urgency
from mdrive_sumo.v2x.messages import Direction, Intention, Mcm, ReferencePose, decode


def announced(car: NegotiationMember, tick: int, terms: NegotiationTerms | None = None) -> Message:
    return build_mcm_message(car, tick, terms or NegotiationTerms())


def test_members_are_compensated_for_age() -> None:
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


def test_a_station_silent_for_more_than_a_second_is_dropped() -> None:
    roster = PeerTable()
    roster.receive(announced(member("a", 0, 0, 0.0), 5))
    assert len(roster.predict_members(5 + MEMORY_TICKS)) == 1
    assert roster.predict_members(6 + MEMORY_TICKS) == ()


def test_older_and_unreadable_messages_are_ignored() -> None:
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


def test_a_leader_goes_first() -> None:
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


def test_by_the_rules_of_etsi_cars_agree_by_fewer_messages() -> None:
    """Cars that drive as they announced tell what they agree to, and then that it holds for longer."""
    sent: dict[str, list[int]] = {}
    for rate in ("fixed", "etsi"):
        negotiators = {name: RuleNegotiator(rate=rate) for name in "ab"}
        steps = {}
        for tick in range(0, 32, 4):
            driven_m = 6.0 * tick / 20
            steps |= talk(crossing(15.0 - driven_m, 17.0 - driven_m), negotiators, 4, first=tick)
        a, b = steps[8]["a"].decision, steps[8]["b"].decision
        assert a is not None and b is not None and (a.priority_over, b.yield_to) == ({"b"}, {"a"})
        sent[rate] = [tick for tick in steps if steps[tick]["a"].messages]
    assert sent["fixed"] == list(range(0, 32, 4))
    assert sent["etsi"][:2] == [0, 4] and len(sent["etsi"]) <= 5 and max(np.diff(sent["etsi"])) <= 20


def test_a_claim_holds_when_the_other_car_gets_nearer() -> None:
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


def test_the_original_defect_stops_the_first_station() -> None:
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
