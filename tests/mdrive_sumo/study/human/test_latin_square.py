"""Orders: every item equally often in every place, and equally often right after every other."""

from collections import Counter
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.human_study import PAIRED, make_plan

from mdrive_sumo.study.human.drive_order import plan_drives
from mdrive_sumo.study.human.latin_square import build_latin_square, order_items
from mdrive_sumo.study.human.plan_file import count_orders, describe_balance


@given(st.integers(1, 24))
def test_every_number_is_equally_often_in_every_column_and_after_every_other(size: int) -> None:
    square = build_latin_square(size)
    assert len(square) == (2 * size if size % 2 and size > 1 else size)
    times = len(square) // size
    assert all(sorted(row) == list(range(size)) for row in square)
    for column in zip(*square, strict=True):
        assert set(Counter(column).values()) == {times}
    after = Counter(pair for row in square for pair in pairwise(row))
    assert len(after) == size * (size - 1)
    assert set(after.values()) <= {times}


@given(st.lists(st.text(max_size=3), min_size=1, max_size=8, unique=True), st.integers(0, 1000))
def test_rows_repeat_after_the_last_one(items: list[str], row: int) -> None:
    ordered = order_items(items, row)
    assert sorted(ordered) == sorted(items)
    assert ordered == order_items(items, row + len(build_latin_square(len(items))))


def test_a_square_of_nothing_is_refused() -> None:
    with pytest.raises(ValueError, match="at least 1"):
        build_latin_square(0)


@given(st.integers(1, 5), st.integers(1, 5), st.integers(0, 40))
def test_a_crossed_participant_drives_every_scenario_in_every_condition(
    scenarios: int, conditions: int, place: int
) -> None:
    plan = make_plan(
        participants=41,
        scenarios=[f"s{i}" for i in range(scenarios)],
        conditions=[{"name": f"c{i}"} for i in range(conditions)],
    )
    drives = plan_drives(plan, plan.codes[place])
    assert [drive.number for drive in drives] == list(range(scenarios * conditions))
    assert len({(drive.scenario.id, drive.condition.name) for drive in drives}) == scenarios * conditions
    blocks = [drive.condition.name for drive in drives][::scenarios]
    assert [drive.condition.name for drive in drives] == [name for name in blocks for _ in range(scenarios)]


@given(st.integers(1, 6), st.integers(1, 4))
def test_rotated_scenarios_are_driven_once_and_over_the_participants_equally_often_in_each_condition(
    scenarios: int, conditions: int
) -> None:
    plan = make_plan(
        participants=2 * conditions,
        order="rotated",
        scenarios=[f"s{i}" for i in range(scenarios)],
        conditions=[{"name": f"c{i}"} for i in range(conditions)],
    )
    met: Counter[tuple[str, str]] = Counter()
    for code in plan.codes:
        drives = plan_drives(plan, code)
        assert sorted(drive.scenario.id for drive in drives) == sorted(scenario.id for scenario in plan.scenarios)
        met.update((drive.scenario.id, drive.condition.name) for drive in drives)
    assert set(met.values()) == {2}


def test_both_of_a_pair_drive_the_same_in_neighbouring_cars() -> None:
    plan = make_plan(conditions=PAIRED)
    first, second = (plan_drives(plan, code) for code in plan.codes[:2])
    assert [(one.name, one.condition) for one in first] == [(one.name, one.condition) for one in second]
    for one, other in zip(first, second, strict=True):
        assert (one.cav, other.cav) == ((0, 1) if one.condition.has_person else (0, 0))
        assert one.partner_cav == 1
        assert other.partner_cav == (0 if one.condition.has_person else 1)
    assert plan.find_partner("P01") == "P02" and plan.find_partner("P04") == "P03"


def test_it_is_told_when_orders_are_not_balanced() -> None:
    assert count_orders(make_plan()) == 2
    assert describe_balance(make_plan()) == ""
    assert describe_balance(make_plan(participants=3)) == ("3 participants: orders are balanced with a multiple of 2")
    assert describe_balance(make_plan(conditions=PAIRED, participants=2)).startswith("1 pairs of participants")
