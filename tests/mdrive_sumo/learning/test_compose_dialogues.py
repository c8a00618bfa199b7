"""Conversations: who knows what, what is learned, and that words decide where only they tell."""

import random
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.learning.dialogue.compose_dialogues import (
    SHARES,
    DialogueShares,
    choose_action,
    compose_conversation,
    compose_pairs,
    is_usable,
    leave_out_objects,
    move_back,
    settle_ties,
)
from mdrive_sumo.learning.dialogue.dialogue_collection import drop_words
from mdrive_sumo.learning.dialogue.dialogue_samples import Dialogue, encode_dialogues
from mdrive_sumo.learning.dialogue.situations import OrderOutcome, Situation
from mdrive_sumo.learning.dialogue.synthetic_dialogues import draw_situation
from mdrive_sumo.negotiation.dialogue.answers import parse_agreement, parse_proposal, replace_letters
from mdrive_sumo.negotiation.dialogue.dialogue_view import DialogueView, Hold, MemberView
from mdrive_sumo.negotiation.dialogue.vocabulary import AGREE, SAY, load_vocabulary
from mdrive_sumo.v2x.messages import Direction, Intention

VOCABULARY = load_vocabulary()
QUIET = DialogueShares(made_up=0.0, modest=0.0, silent=0.0, mistaken=0.0, second_round=0.0, faster=0.0)


def make_situation(seed: int, members: int = 3) -> Situation:
    return draw_situation(random.Random(seed), "p", members)


def find_entries(agreed: Dialogue) -> dict[str, float]:
    """When members enter their areas, by the prompt."""
    lines = [line for line in agreed.lines if ", zone " in line and not line.startswith("said")]
    return {line[0]: float(line.split(", zone ")[1].split()[0]) for line in lines}


@given(st.integers(0, 2**31), st.integers(2, 8))
def test_every_message_fits_the_grammar_and_200_bytes_and_the_agreement_knows_all_members(
    seed: int, members: int
) -> None:
    dialogues = compose_conversation(make_situation(seed, members), random.Random(seed), VOCABULARY, seed % 2 == 0)
    encode_dialogues(VOCABULARY, dialogues)  # raises for answers outside of the grammar
    assert [each.task for each in dialogues[-1:]] == [AGREE] and len(dialogues) <= members + 1
    for each in dialogues[:-1]:
        sent = replace_letters(each.answer, dict.fromkeys(each.letters, "0123abcd"))
        assert (
            each.task == SAY
            and len(sent.encode()) + len("[01234567 1] ") <= 200
            and parse_proposal(each.answer, each.letters)
        )
    assert set(parse_agreement(dialogues[-1].answer, dialogues[-1].letters).order) == set(dialogues[-1].letters)


@given(st.integers(0, 2**31))
def test_without_mishaps_all_agree_on_the_order_of_the_teacher(seed: int) -> None:
    situation = make_situation(seed)
    *said, agreed = compose_conversation(situation, random.Random(seed), VOCABULARY, False, QUIET)
    final = parse_agreement(agreed.answer, agreed.letters)
    proposals = [parse_proposal(each.answer, each.letters) for each in said]
    assert [one.stance for one in proposals] == ["propose", "accept", "accept"] and final.consensus == 1.0
    assert {one.order for one in proposals} == {final.order}
    zones = find_entries(agreed)
    assert list(final.order) == sorted(zones, key=lambda letter: zones[letter])  # the teacher's: first in, first out


def test_what_only_words_tell_decides_a_third_of_the_agreements() -> None:
    """With everybody's heads but without the words, the first order would be the right one."""
    decided = total = 0
    for seed in range(200):
        *_, agreed = compose_conversation(make_situation(seed), random.Random(seed), VOCABULARY, False)
        zones = find_entries(agreed)
        order = "".join(parse_agreement(agreed.answer, agreed.letters).order)
        total += 1
        decided += order != "".join(sorted(zones, key=lambda letter: zones[letter]))
    assert decided / total >= 0.3


def test_who_is_held_up_modestly_says_it_in_words_only_and_the_agreement_follows() -> None:
    shares = replace(QUIET, made_up=1.0, modest=1.0)
    found = 0
    for seed in range(30):
        dialogues = compose_conversation(make_situation(seed), random.Random(seed), VOCABULARY, False, shares)
        *said, agreed = dialogues
        held = {line[5] for line in agreed.lines if line.startswith("said") and line[5] not in {d.me for d in said}}
        order = parse_agreement(agreed.answer, agreed.letters).order
        assert not held or set(order[-len(held) :]) == held  # their own messages are not learned, and they pass last
        heads = [line.split(" ")[3].replace(">", "") for line in agreed.lines if line.startswith("said")]
        found += heads[-1] != "".join(order) and agreed.lines[-1][5] in held
    assert found > 3


def test_ties_go_to_the_first_letter_unless_that_was_worse_or_overtakes_a_leader() -> None:
    situation = make_situation(0)
    seen = [replace(one, zone_s=(2.0, 3.0), follows="") for one in situation.views[0].members]
    tied = replace(situation, views=(replace(situation.views[0], members=tuple(seen)), *situation.views[1:]))
    assert settle_ties(tied, "CBA") == "ABC" and settle_ties(situation, "CBA") == "CBA"
    tried = tuple(OrderOutcome(order, 0.9 if order == "CBA" else 0.5, 0, 0.0) for order in ("CBA", "BCA", "CAB"))
    assert settle_ties(replace(tied, outcomes=tried), "CBA") == "CBA"
    seen[0] = replace(seen[0], follows="C")
    behind = replace(tied, views=(replace(tied.views[0], members=tuple(seen)), *tied.views[1:]))
    assert settle_ties(behind, "CBA") == "BCA"


def test_orders_with_holds() -> None:
    holds = {"A": Hold("car", 3.0, 6.0), "C": Hold("car", 3.0, 2.0)}
    assert move_back("ABCD", holds) == "BDCA" and move_back("ABCD", {}) == "ABCD"


@pytest.mark.parametrize(
    ("zones", "speed", "hold", "expected"),
    [
        (((1.0, 2.0), (2.0, 3.0)), 8.0, None, Intention.KEEP),
        (((1.0, 2.0), (1.9, 3.0)), 8.0, None, Intention.SLOWER),
        (((1.0, 3.0), (0.0, 3.0)), 8.0, None, Intention.SLOWER),
        (((1.0, 3.1), (0.0, 3.0)), 8.0, None, Intention.STOP),
        (((1.0, 3.0), None), 3.0, None, Intention.FASTER),
        ((None, (0.0, 3.0)), 8.0, None, Intention.KEEP),
        ((None, None), 8.0, Hold("car", 9.0), Intention.STOP),
        ((None, None), 8.0, Hold("car", 10.0), Intention.SLOWER),
    ],
)
def test_actions_of_the_second(
    zones: tuple[tuple[float, float] | None, ...], speed: float, hold: Hold | None, expected: Intention
) -> None:
    first, second = zones
    members = (
        MemberView("A", Direction.FOLLOW, 8.0, Intention.KEEP, first),
        MemberView("B", Direction.FOLLOW, speed, Intention.KEEP, second),
    )
    assert choose_action(DialogueView("A", members), "AB", "B", hold) == expected


def test_pairs_are_answers_to_the_same_request_and_the_worse_order_was_simulated() -> None:
    situation = make_situation(1, 2)
    outcomes = (OrderOutcome("AB", 0.9, 0, 0.0), OrderOutcome("BA", 0.5, 0, 0.0))
    pairs = compose_pairs(replace(situation, outcomes=outcomes), random.Random(0), VOCABULARY, False)
    assert [pair.better.task for pair in pairs] == [SAY, AGREE]
    for pair in pairs:
        assert pair.better.lines == pair.worse.lines and pair.better.answer != pair.worse.answer
        encode_dialogues(VOCABULARY, [pair.better, pair.worse])
    same = (outcomes[0], replace(outcomes[1], progress=0.87))
    assert compose_pairs(replace(situation, outcomes=same), random.Random(0), VOCABULARY, False) == []


def test_twins_have_no_words_or_no_objects_and_large_groups_are_not_trained_on() -> None:
    dialogues = compose_conversation(make_situation(3), random.Random(0), VOCABULARY, False)
    assert all(":" not in line for each in map(drop_words, dialogues) for line in (*each.lines, each.answer))
    assert all(not view.objects and not view.traffic for view in leave_out_objects(make_situation(3)).views)
    assert is_usable(make_situation(0, 4), "train") and is_usable(make_situation(0, 5), "test")
    assert not is_usable(make_situation(0, 5), "train") and SHARES.made_up >= 0.3
