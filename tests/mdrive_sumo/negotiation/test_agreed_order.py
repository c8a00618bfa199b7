"""An agreed order of passing: what it means to each member, who cannot keep to it, and when it is done."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.negotiation_fakes import crossing, lines_of, member, talk

from mdrive_sumo.contract import Note
from mdrive_sumo.negotiation import LlmNegotiator, NegotiationDecision, NegotiationMember, NegotiationStep
from mdrive_sumo.negotiation.agreement import build_decision, find_exits, move_forward, release_passed
from mdrive_sumo.negotiation.conflict_graph import CONFLICT
from mdrive_sumo.negotiation.conversation import Conversation
from mdrive_sumo.negotiation.critic import evaluate_actions
from mdrive_sumo.negotiation.order_prediction import can_carry_out, predict_agreement
from mdrive_sumo.negotiation.speaker import GroupAgreement
from mdrive_sumo.v2x.messages import MCM, Intention, Mcm, decode

A_FIRST = {"a": Intention.KEEP, "b": Intention.SLOWER}
B_FIRST = {"a": Intention.SLOWER, "b": Intention.KEEP}


@dataclass
class OrderSpeaker:
    """Says the same order in every round."""

    order: tuple[str, ...]
    actions: Mapping[str, Intention]
    notes: list[Note] = field(default_factory=list[Note])

    def say(self, conversation: Conversation, speaker: str, members: Mapping[str, NegotiationMember]) -> str:
        return f"propose {'>'.join(self.order)} {self.actions[speaker].name.lower()}"

    def conclude(
        self, conversation: Conversation, me: str, members: Mapping[str, NegotiationMember]
    ) -> GroupAgreement | None:
        return GroupAgreement(self.actions, self.order, 1.0)


def agree(
    cars: Mapping[str, NegotiationMember], order: tuple[str, ...], actions: Mapping[str, Intention], ticks: int = 16
) -> dict[int, dict[str, NegotiationStep]]:
    return talk(cars, {name: LlmNegotiator(OrderSpeaker(order, actions)) for name in cars}, ticks)


def mcm_of(step: NegotiationStep) -> Mcm:
    content = decode(next(message for message in step.messages if message.type == MCM))
    assert isinstance(content, Mcm)
    return content


def decision_of(step: NegotiationStep) -> NegotiationDecision:
    assert step.decision is not None
    return step.decision


def test_the_order_in_the_mcm_decides_and_all_answer_yes() -> None:
    steps = agree(crossing(), ("b", "a"), {"a": Intention.KEEP, "b": Intention.KEEP})
    asked = next(mcm_of(step) for by_name in steps.values() for step in by_name.values() if step.decision)
    assert (asked.group, asked.answers) == (("b", "a"), {"a": True})  # a is the more central one of equals
    a, b = decision_of(steps[15]["a"]), decision_of(steps[15]["b"])
    assert (a.yield_to, a.priority_over, b.yield_to, b.priority_over) == ({"b"}, set(), set(), {"a"})
    assert a.group == b.group == ("b", "a")
    told = mcm_of(steps[12]["b"])
    assert (told.group, told.answers) == (("b", "a"), {"a": True})
    assert json.loads(lines_of(steps, "negotiation")[-1])["order"] == ["b", "a"]


def test_without_an_order_the_actions_decide_and_the_group_is_sorted() -> None:
    steps = agree(crossing(), (), {"a": Intention.STOP, "b": Intention.FASTER})
    asked = next(mcm_of(step) for by_name in steps.values() for step in by_name.values() if step.decision)
    assert (asked.group, asked.answers) == (("a", "b"), {})
    assert decision_of(steps[15]["b"]).priority_over == {"a"}
    assert "order" not in json.loads(lines_of(steps, "negotiation")[-1])


def test_who_cannot_brake_any_more_refuses_and_goes_first() -> None:
    """b is 6 m before the crossing at 6 m/s; to stop 3.55 m before it takes more than 4 m/s2."""
    cars = crossing(a_run=9.0, b_run=6.0)
    steps = agree(cars, ("a", "b"), A_FIRST, ticks=24)
    refused = [json.loads(line) for line in lines_of(steps, "negotiation") if "refusal" in line]
    assert [(one["refused"], one["order"]) for one in refused] == [(["b"], ["b", "a"])]
    refusals = [
        (tick, mcm_of(step["b"]).answers)
        for tick, step in steps.items()
        if any(message.type == MCM for message in step["b"].messages) and False in mcm_of(step["b"]).answers.values()
    ]
    assert refusals[0][1] == {"a": False}
    assert (decision_of(steps[23]["a"]).yield_to, decision_of(steps[23]["b"]).priority_over) == ({"b"}, {"a"})
    assert mcm_of(steps[20]["b"]).answers == {"a": True}
    assert decision_of(steps[23]["a"]).intention == Intention.SLOWER


def test_an_agreement_that_is_refused_twice_is_dropped() -> None:
    """Neither can wait for the other one; they talk about it again a second later."""
    steps = agree(crossing(a_run=4.0, b_run=4.5), ("a", "b"), A_FIRST, ticks=24)
    decided_by = [json.loads(line)["by"] for line in lines_of(steps, "negotiation")]
    assert decided_by == ["model", "refusal"]
    assert steps[20]["a"].decision is None and steps[20]["b"].decision is None
    assert "order" not in lines_of(steps, "negotiation")[1]


def test_a_conflict_is_settled_once() -> None:
    """The plans still meet, and would without an order make the group talk again a second later."""
    ordered = agree(crossing(), ("a", "b"), A_FIRST, ticks=41)
    unordered = agree(crossing(), (), dict.fromkeys("ab", Intention.KEEP), ticks=41)
    assert len(lines_of(ordered, "negotiation")) == 1
    assert len(lines_of(unordered, "negotiation")) > 3


@pytest.mark.parametrize(("b_run", "is_possible"), [(6.0, False), (9.0, True), (30.0, True)])
def test_who_can_carry_out_an_order(b_run: float, is_possible: bool) -> None:
    """6 m/s: 36 / (2 * 4) = 4.5 m of braking, and 3.55 m to the middle of the crossing."""
    members = tuple(crossing(12.0, b_run).values())
    assert can_carry_out("b", members, A_FIRST, ("a", "b")) is is_possible
    assert can_carry_out("a", members, A_FIRST, ("a", "b"))


def test_the_critic_knows_that_only_one_waits_for_the_other() -> None:
    members = tuple(crossing(10.0, 12.0).values())
    slow = evaluate_actions(members, A_FIRST)
    ordered = evaluate_actions(members, A_FIRST, ("a", "b"))
    assert ordered.feedback == "" and ordered.safety >= 0.75
    assert ordered.efficiency > slow.efficiency
    late = evaluate_actions(tuple(crossing(10.0, 4.0).values()), A_FIRST, ("a", "b"))
    assert "too close" in late.feedback


def test_a_leader_stays_before_the_one_that_follows_it() -> None:
    """c drives behind b and refuses: b has to go before it."""
    cars = (member("a", -12, 0, 0.0), member("b", 0, -6, math.pi / 2), member("c", 0, -13, math.pi / 2))
    agreement = GroupAgreement(dict.fromkeys("abc", Intention.KEEP), ("a", "b", "c"))
    changed = move_forward(["c"], agreement, cars)
    assert changed.order == ("b", "c", "a")
    assert changed.actions == {"a": Intention.SLOWER, "b": Intention.KEEP, "c": Intention.KEEP}


def drive_on(car: NegotiationMember, metres: float) -> NegotiationMember:
    return member(car.id, car.x + metres * math.cos(car.yaw), car.y + metres * math.sin(car.yaw), car.yaw)


def test_an_agreement_ends_when_those_that_go_first_have_passed() -> None:
    a, b = crossing(10.0, 12.0).values()
    waiting = NegotiationDecision(Intention.STOP, frozenset("a"), frozenset(), 90, ("a", "b"))
    exits = find_exits("b", (a, b), "a")
    assert exits["a"] == pytest.approx((3.2, 0.0), abs=1.2)  # 3.55 m after the crossing, in steps of 1.2 m
    assert release_passed(waiting, "b", (a, b), exits) is waiting
    assert release_passed(waiting, "b", (drive_on(a, 10.0), b), exits) is waiting  # in the middle
    assert release_passed(waiting, "b", (a, drive_on(b, -40.0)), exits) is waiting  # far away is not past
    assert release_passed(waiting, "b", (drive_on(a, 16.0), b), exits) is None
    assert release_passed(waiting, "b", (b,), exits) is waiting  # silent, who knows
    before_c = replace(waiting, priority_over=frozenset("c"))
    released = release_passed(before_c, "b", (drive_on(a, 16.0), b), exits)
    assert released == replace(before_c, intention=Intention.KEEP, yield_to=frozenset())


places = st.floats(-40, 40, allow_nan=False)
cars_of_some_group = st.lists(
    st.tuples(places, places, st.floats(-3.1, 3.1), st.floats(0, 8)), min_size=2, max_size=5
).map(lambda rows: tuple(member("abcde"[i], *row) for i, row in enumerate(rows)))


@given(cars_of_some_group, st.lists(st.sampled_from(Intention), min_size=5, max_size=5))
def test_members_pass_behind_those_before_them(
    cars: Sequence[NegotiationMember], intentions: Sequence[Intention]
) -> None:
    order = tuple(reversed([car.id for car in cars]))
    actions = dict(zip("abcde", intentions, strict=True))
    motions = predict_agreement(cars, actions, order)
    assert tuple(motions) == order
    for i, name in enumerate(order):
        for earlier in order[:i]:
            for step, point in enumerate(motions[name].points):
                gap = min(math.dist(point, later) for later in motions[earlier].points[step:])
                assert gap >= CONFLICT.min_distance_m - 1e-9 or not motions[name].is_behind


@given(cars_of_some_group)
def test_members_agree_on_who_goes_first(cars: Sequence[NegotiationMember]) -> None:
    order = tuple(reversed([car.id for car in cars]))
    agreement = GroupAgreement(dict.fromkeys(order, Intention.KEEP), order)
    decisions = {name: build_decision(name, cars, agreement, order, 9) for name in order}
    for one in order:
        for other in decisions[one].yield_to:
            assert one in decisions[other].priority_over and order.index(other) < order.index(one)
