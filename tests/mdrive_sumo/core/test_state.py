"""Road users as a struct of arrays: concatenation, selection, merging by id and motion prediction."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.twins import compare_twins

from mdrive_sumo.contract import Objects
from mdrive_sumo.core.state import Actors, EgoState, Kind


def users(ids: str, kind: Kind = Kind.VEHICLE) -> Actors:
    """One row per letter; every column counts up from a start of its own."""
    rows = np.arange(len(ids), dtype=np.float64)
    columns = [rows + 10 * (column + 1) for column in range(6)]
    return Actors(tuple(ids), np.full(len(ids), kind, dtype=np.uint8), *columns)


def test_concat_keeps_order_dtype_and_the_free_sight_of_the_first_part() -> None:
    seen = Objects.empty()
    seen = replace(seen, free_m=np.array([1.0, 2.0]))
    both = seen.concat(users("ba"), users("", Kind.STATIC), users("c", Kind.PEDESTRIAN))
    assert isinstance(both, Objects)
    assert both.ids == ("b", "a", "c")
    assert both.kind.dtype == np.uint8
    assert both.kind.tolist() == [Kind.VEHICLE, Kind.VEHICLE, Kind.PEDESTRIAN]
    assert both.y.tolist() == [20.0, 21.0, 20.0]
    assert both.free_m.tolist() == [1.0, 2.0]
    assert seen.concat(Actors.empty()) is seen


@pytest.mark.parametrize("rows", [np.array([2, 0]), np.array([True, False, True]), slice(None, None, 2)])
def test_take_selects_rows_by_index_mask_or_slice(rows: np.ndarray | slice) -> None:
    taken = users("abc").take(rows)
    expected = ("c", "a") if isinstance(rows, np.ndarray) and rows.dtype != np.bool_ else ("a", "c")
    assert taken.ids == expected
    assert taken.width.tolist() == [60.0 + "abc".index(name) for name in expected]


def test_merge_sorts_by_id_and_keeps_the_ids_object_while_the_actors_stay_the_same() -> None:
    cars, pole = users("ac"), users("b", Kind.STATIC)
    first, second = cars.merge(pole), replace(cars, x=2 * cars.x).merge(pole)
    assert first.ids == ("a", "b", "c")
    assert second.ids is first.ids
    assert second.kind.tolist() == [Kind.VEHICLE, Kind.STATIC, Kind.VEHICLE]
    assert second.x.tolist() == [20.0, 10.0, 22.0]
    assert cars.merge(Actors.empty()) is cars
    assert Actors.empty().merge(pole) is pole


def test_from_egos_gives_one_vehicle_per_cav_in_their_order() -> None:
    egos = {"b": EgoState(1, 2, 3, 4), "a": EgoState(5, 6, 7, 8)}
    table = Actors.from_egos(egos, {"a": (4.0, 2.0), "b": (5.0, 1.5)})
    assert table.ids == ("b", "a")
    assert table.kind.tolist() == [Kind.VEHICLE, Kind.VEHICLE]
    assert np.column_stack((table.x, table.speed, table.length, table.width)).tolist() == [[1, 4, 5, 1.5], [5, 8, 4, 2]]
    assert len(Actors.from_egos({}, {})) == 0


NUMBERS = st.one_of(st.floats(), st.integers(-9, 9))
ROWS = st.tuples(st.builds(EgoState, NUMBERS, NUMBERS, NUMBERS, NUMBERS), st.tuples(NUMBERS, NUMBERS))


@given(parts=st.lists(st.lists(ROWS, max_size=4), min_size=1, max_size=3))
def test_compiled_columns_are_those_of_the_python_text(
    parts: list[list[tuple[EgoState, tuple[float, float]]]],
) -> None:
    users = [
        Actors(
            ("a",) * len(rows),
            *compare_twins("core_state_build_ego_columns", [ego for ego, _ in rows], [size for _, size in rows]),
        )
        for rows in parts
    ]
    compare_twins("core_state_join_columns", users)
    compare_twins("core_state_join_columns", [one.take(slice(None, None, -1)) for one in users])


def test_columns_of_different_lengths_are_refused() -> None:
    compare_twins("core_state_build_ego_columns", [EgoState(1.0, 2.0, 3.0, 4.0)], [])
    with pytest.raises(ValueError, match="expected columns with 2 rows, one for each id, found 1"):
        users("ab").concat(replace(users("ab"), yaw=np.zeros(1)))


def test_advance_moves_straight_without_turn_and_on_an_arc_with_one() -> None:
    car = Actors(("a",), np.zeros(1, dtype=np.uint8), *(np.array([value]) for value in (0.0, 0.0, 0.0, 10.0, 4.0, 2.0)))
    straight = car.advance(2.0)
    assert (straight.x.tolist(), straight.y.tolist(), straight.yaw.tolist()) == ([20.0], [0.0], [0.0])
    quarter = car.advance(np.array([math.pi]), np.array([math.pi / 2]))  # a radius of 20 m
    assert quarter.x[0] == pytest.approx(20.0)
    assert quarter.y[0] == pytest.approx(20.0)
    assert quarter.yaw[0] == pytest.approx(math.pi / 2)


@given(rows=st.lists(st.integers(-5, 4), max_size=9))
def test_compiled_selection_is_that_of_the_python_text(rows: list[int]) -> None:
    chosen = np.array(rows, dtype=np.intp)
    compare_twins("core_state_select_columns", [users("ab"), users("cde")], chosen)
    assert users("abcde").take(chosen).ids == tuple("abcde"[row] for row in rows)
    compare_twins("core_state_select_columns", [users("abcde").take(slice(None, None, -1))], chosen)


def test_rows_that_do_not_exist_are_refused() -> None:
    with pytest.raises((ValueError, IndexError)):
        users("ab").take(np.array([2]))
