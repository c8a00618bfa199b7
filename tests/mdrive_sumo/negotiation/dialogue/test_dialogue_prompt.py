"""Prompts: their lines, and that they always fit and never lose what decides."""

import random
from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.learning.dialogue.synthetic_dialogues import draw_situation
from mdrive_sumo.negotiation.dialogue.dialogue_prompt import (
    MAX_PROMPT_ENTRIES,
    SaidLine,
    Talk,
    format_close_pair,
    format_prompt,
)
from mdrive_sumo.negotiation.dialogue.dialogue_view import DialogueView, Hold, MemberView, ToldObject
from mdrive_sumo.negotiation.dialogue.vocabulary import AGREE, SAY, load_vocabulary
from mdrive_sumo.v2x.messages import Direction, Intention

VOCABULARY = load_vocabulary()
ME = MemberView("B", Direction.LEFT, 7.4, Intention.KEEP, (3.1, 5.0))
FIRST = MemberView(
    "A", Direction.STRAIGHT, 8.0, Intention.KEEP, (2.4, 3.8), 23.4, "ahead right", "from right to left", True, "", 1.1
)
LAST = MemberView("C", Direction.FOLLOW, 6.0, Intention.SLOWER, None, 12.0, "behind", "same direction", False, "B")
OBJECTS = (
    ToldObject("", "pedestrian", 9.2, "ahead left", 1.3),
    ToldObject("A", "car", 30.0, "left", 0.1, 2.2),
)
VIEW = DialogueView("B", (FIRST, ME, LAST), (("B", "A"),), "green", Hold("pedestrian", 9.0, 3.0), OBJECTS, 12)
SAID = SaidLine(1, "A", "propose A>B>C keep: I am nearest")


def test_the_prompt_of_a_speaker() -> None:
    talk = Talk((SAID, replace(SAID, letter="C", round=2)), format_close_pair("A", "B"), 2)
    assert format_prompt(SAY, VIEW, talk, VOCABULARY) == [
        "rules lights green, B yields to A",
        "me B turns left 7.5 m/s keep, zone 3.1 to 5.0 s, held by pedestrian 9 m ahead for 3.0 s",
        "A straight 8.0 m/s keep, 23 m ahead right, from right to left, zone 2.4 to 3.8 s, conflict, sigma 1 m",
        "C straight 6.0 m/s slower, 12 m behind, same direction, follows B",
        "own pedestrian 9 m ahead left 1.5 m/s",
        "A says car 30 m left standing sigma 2 m",
        "traffic 12",
        "said A propose A>B>C keep: I am nearest",
        "said C propose A>B>C keep: I am nearest",
        "critic A and B too close",
        "round 2",
    ]


def test_who_concludes_knows_the_last_round_and_nothing_of_its_own() -> None:
    talk = Talk((SAID, replace(SAID, letter="C", round=2)), format_close_pair("A", "B"), 2)
    assert format_prompt(AGREE, VIEW, talk, VOCABULARY) == [
        "rules lights green, B yields to A",
        "A straight 8.0 m/s keep, 23 m ahead right, from right to left, zone 2.4 to 3.8 s, conflict, sigma 1 m",
        "B turns left 7.5 m/s keep, zone 3.1 to 5.0 s",
        "C straight 6.0 m/s slower, 12 m behind, same direction, follows B",
        "said C propose A>B>C keep: I am nearest",
        "round 2",
    ]


@given(st.integers(0, 2**31), st.integers(2, 8), st.sampled_from((SAY, AGREE)))
def test_prompts_fit_whatever_was_said_and_keep_what_decides(seed: int, members: int, task: int) -> None:
    draw = random.Random(seed)
    situation = draw_situation(draw, "p", members)
    order = ">".join(situation.letters)
    words = " ".join(draw.choice(("I", "wait", "for", "you", "A", "B")) for _ in range(40))
    said = [
        SaidLine(number, letter, f"object {order} slower: {words}") for number in (1, 2) for letter in situation.letters
    ]
    view = situation.views[0]
    lines = format_prompt(task, view, Talk(tuple(said[:-1]), "faster", 2), VOCABULARY)
    assert len(VOCABULARY.encode_prompt(task, lines)) <= MAX_PROMPT_ENTRIES
    starts = [line.split(" ")[1] if line.startswith("me ") else line.split(" ")[0] for line in lines]
    assert set(situation.letters) <= set(starts) and lines[0].startswith("rules ")
    last = [line for line in lines if line.startswith("said ")][-(members - 1) :]
    assert [line[5] for line in last] == list(situation.letters[:-1]) and all(
        f"object {order} slower" in line for line in last
    )


def test_a_long_prompt_loses_traffic_first_and_details_of_far_members_last() -> None:
    text = "propose A>B>C keep: " + " ".join(["wait"] * 38)
    lines = format_prompt(SAY, VIEW, Talk(tuple(SaidLine(1, "A", text) for _ in range(7)), "", 1), VOCABULARY)
    assert "traffic 12" not in lines and lines[3].startswith("C straight")
    longer = Talk(tuple(SaidLine(1, "A", text) for _ in range(9)), "", 1)
    lines = format_prompt(SAY, VIEW, longer, VOCABULARY)
    assert not any(line.startswith(("own", "A says")) for line in lines) and "A straight 8.0 m/s keep" in lines
