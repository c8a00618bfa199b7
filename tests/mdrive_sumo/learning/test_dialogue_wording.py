"""Words of messages: how many patterns there are, which are held out, and that they are words of the grammar."""

import random

from mdrive_sumo.learning.dialogue.wording import (
    CLAUSES,
    HELD_OUT,
    Clause,
    count_patterns,
    draw_pattern,
    draw_words,
    get_slots,
    is_pattern_held_out,
)

SLOTS = {
    "first": "A", "second": "B", "before": "A", "next": "C", "last": "D", "said": "B", "held": "C", "entry": "2.4",
    "leave": "4.0", "hold": "an obstacle 9 m ahead", "seconds": "4.0", "object": "car", "metres": "12",
    "sector": "left",
}  # fmt: skip
CONTEXTS = [
    [Clause("other-first"), Clause("slower", 0.5), Clause("request", 0.3)],
    [Clause("me-first"), Clause("keep", 0.5), Clause("seen", 0.3)],
    [Clause("object"), Clause("fact"), Clause("fact-time", 0.9), Clause("stop", 0.5)],
]


def test_more_than_ten_thousand_patterns_are_drawn_and_a_tenth_is_held_out() -> None:
    draw = random.Random(0)
    patterns = {draw_pattern(CONTEXTS[i % 3], SLOTS, draw) for i in range(13_000)}
    assert len(patterns) > 10_000
    share = sum(map(is_pattern_held_out, patterns)) / len(patterns)
    assert abs(share - 1 / HELD_OUT) < 0.01


def test_training_and_validation_draw_other_patterns() -> None:
    unfilled = {name: f"<{name}>" for name in SLOTS}
    drawn: dict[bool, set[str]] = {False: set(), True: set()}
    for is_held_out, texts in drawn.items():
        draw = random.Random(1)
        texts |= {draw_words(CONTEXTS[0], unfilled, draw, is_held_out) for _ in range(500)}
    assert not drawn[False] & drawn[True] and min(map(len, drawn.values())) > 300


def test_clauses_without_their_slots_are_left_out() -> None:
    assert draw_words([Clause("fact")], {}, random.Random(0)) == ""
    assert get_slots("I [let|leave] {first} go, {next}") == {"first", "next"}
    assert set().union(*(get_slots(one) for clauses in CLAUSES.values() for one in clauses)) == set(SLOTS)


def test_patterns_of_a_clause_are_the_products_of_its_choices() -> None:
    assert count_patterns("fact-time") == 3 + 4 + 4 * 2
