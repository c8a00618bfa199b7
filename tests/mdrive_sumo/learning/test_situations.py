"""Situations: which order is taught, other letters, files, teachers and the orders that are worth a simulation."""

import gzip
import math
import random
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.negotiation_fakes import crossing, member

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.learning.dialogue.agreement_search import OrderTrial, build_order_decision
from mdrive_sumo.learning.dialogue.situations import (
    OrderOutcome,
    Situation,
    read_situations,
    rename_members,
    write_situations,
)
from mdrive_sumo.learning.dialogue.synthetic_dialogues import draw_situation
from mdrive_sumo.learning.dialogue.teachers import (
    choose_candidates,
    find_driven_order,
    find_passing_order,
    find_rule_order,
)
from mdrive_sumo.negotiation.conflict_graph import build_conflict_graph
from mdrive_sumo.v2x.messages import Intention


def make_situation(**changes: object) -> Situation:
    return replace(draw_situation(random.Random(0), "p", 3), **changes)  # pyright: ignore[reportArgumentType]


TAUGHT = {"passing": "ABC", "rule": "BAC", "omniscient": "CAB"}


@pytest.mark.parametrize(
    ("outcomes", "expected", "worse"),
    [
        ((), "ABC", []),
        ((("ABC", 0.5, 0, 0.0), ("CAB", 0.5, 0, 0.0)), "ABC", []),
        ((("ABC", 0.495, 0, 0.0), ("CAB", 0.5, 0, 0.0)), "ABC", []),
        ((("ABC", 0.4, 0, 0.0), ("CAB", 0.5, 0, 0.0), ("BAC", 0.5, 0, 0.0)), "CAB", ["ABC"]),
        ((("ABC", 0.4, 0, 0.0), ("CBA", 0.5, 0, 0.0)), "CBA", ["ABC"]),
        ((("ABC", 0.9, 1, 0.0), ("CBA", 0.9, 0, 0.9), ("BAC", 0.1, 0, 0.0)), "BAC", ["ABC", "CBA"]),
    ],
)
def test_the_taught_order(outcomes: tuple[tuple[str, float, int, float], ...], expected: str, worse: list[str]) -> None:
    situation = make_situation(orders=TAUGHT, outcomes=tuple(OrderOutcome(*one) for one in outcomes))
    assert situation.choose_order() == expected and situation.find_worse(0.05) == worse


def test_renaming_and_back_changes_nothing(tmp_path: Path) -> None:
    situation = make_situation(orders=TAUGHT, outcomes=(OrderOutcome("CAB", 0.5, 0, 0.1),))
    other = rename_members(situation, {"A": "C", "B": "A", "C": "B"})
    assert (
        other.choose_order() == "BCA"
        and other.get_view("C").get_member("A").speed == situation.views[0].members[1].speed
    )
    assert rename_members(other, {"C": "A", "A": "B", "B": "C"}) == situation
    path = tmp_path / "one.json.gz"
    write_situations(path, [situation, other])
    assert read_situations(path) == (situation, other)


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "expected situations, found No such file"),
        (b"words", "expected packed situations, found a damaged file"),
        (gzip.compress(b"[]", mtime=0)[:-6], "found more or a torn file"),
        (gzip.compress(b"[{}]", mtime=0), "0.place: "),
        (gzip.compress(b"{", mtime=0), "Invalid JSON"),
    ],
)
def test_a_damaged_file_is_a_sentence(content: bytes | None, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "one.json.gz"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(InputError, match=expected) as error:
        read_situations(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_teachers_and_candidates() -> None:
    cars = [*crossing(12, 10).values()]
    graph, group = build_conflict_graph(cars), ("a", "b")
    assert find_passing_order(cars, graph, group) == ("b", "a")  # b enters first
    assert sorted(find_rule_order(graph, group)) == ["a", "b"]
    assert choose_candidates(cars, graph, [("b", "a")], 6) == [("b", "a"), ("a", "b")]
    queue = [*cars, member("c", -20, 0, 0)]  # behind a
    behind = build_conflict_graph(queue)
    orders = choose_candidates(queue, behind, [("c", "a", "b"), ("b", "a", "c")], 6)
    assert orders == [("b", "a", "c"), ("a", "b", "c"), ("a", "c", "b")]  # c stays behind a
    assert choose_candidates(queue, behind, [("b", "a", "c")], 2) == orders[:2]
    many = [member(name, 0, 10 * i, 0) for i, name in enumerate("abcd")]
    taught = ("d", "c", "b", "a")
    assert set(choose_candidates(many, build_conflict_graph(many), [taught], 9)) == {
        taught, ("c", "d", "b", "a"), ("d", "b", "c", "a"), ("d", "c", "a", "b"),
    }  # fmt: skip


class Drive:
    """Three CAVs: the first crosses the origin eastward at tick 40, the second northward at 60, the third is far."""

    ticks = 100

    def __init__(self) -> None:
        t: Float = np.arange(100.0)
        self.valid = np.ones((100, 3), dtype=np.bool_)
        self.x = np.column_stack((0.4 * (t - 40), np.zeros(100), 0.4 * t))
        self.y = np.column_stack((np.zeros(100), 0.4 * (t - 60), np.full(100, 90.0)))


def test_the_order_of_a_drive_is_that_of_entering() -> None:
    columns = {"x": 1, "y": 0, "z": 2}
    assert find_driven_order(Drive(), columns) == ("y", "x", "z")  # pyright: ignore[reportArgumentType]


def test_an_order_is_a_decision_of_each_member_about_its_opponents() -> None:
    cars = {**crossing(), "c": member("c", 0.0, 40.0, -math.pi / 2)}
    trial = OrderTrial(("b", "a", "c"), tuple(cars.values()))
    second = build_order_decision("a", trial, 100)
    assert (second.intention, second.yield_to, second.priority_over) == (Intention.SLOWER, {"b"}, frozenset())
    assert 120 < second.until_tick <= 200 and second.group == trial.order
    assert build_order_decision("b", trial, 100).priority_over == build_conflict_graph(trial.members).find_opponents(
        "b"
    )
