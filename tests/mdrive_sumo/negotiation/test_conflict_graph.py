"""Conflict graphs: pairs, groups, times and distances."""

import math

import numpy as np
import pytest
from testing.negotiation_fakes import crossing, member

from mdrive_sumo.negotiation.conflict_graph import (
    build_conflict_graph,
    build_trajectory_graph,
    compute_free_distance,
    compute_safety,
)


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


def test_the_nearer_car_enters_the_crossing_first() -> None:
    graph = build_conflict_graph(list(crossing(12, 10).values()))
    assert graph.get_distance_to_conflict("a") == pytest.approx(
        graph.get_distance_to_conflict("b")
    )  # the protocol's measure cannot tell
    assert graph.get_entry_time("b") < graph.get_entry_time("a") < np.inf
    assert build_conflict_graph([member("a", 0, 0, 0)]).get_entry_time("a") == np.inf


def test_a_lone_car_is_1000_m_from_its_conflict() -> None:
    assert build_conflict_graph([member("a", 0, 0, 0)]).get_distance_to_conflict("a") == 1000.0
    assert build_trajectory_graph((), {}).ids == ()


def test_the_free_distance_before_shared_areas() -> None:
    a, b = crossing(10, 20).values()
    far = member("c", 0, 50, math.pi / 2)
    assert compute_free_distance(a, [b, far]) == pytest.approx(7.2)  # the sixth point, 2.8 m before the crossing
    assert compute_free_distance(b, [a]) == pytest.approx(16.8)
    assert compute_free_distance(a, [far]) == compute_free_distance(a, []) == math.inf
    assert compute_free_distance(a, [a]) == 0.0
