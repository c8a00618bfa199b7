"""Collisions (protocol 7.2), with expectations worked out by hand."""

from collections.abc import Sequence

import pytest
from testing.score_golden import (
    Row,
    arriving,
    ego,
    episode,
    hit,
    lane,
    roads,
    scenario,
    straight,
)
from testing.scored_records import events, record

from mdrive_sumo.core.state import End, Kind
from mdrive_sumo.scoring.metrics import build_ego_records


@pytest.mark.parametrize(
    ("kind", "name", "factor"),
    [
        (Kind.PEDESTRIAN, "collision-pedestrian", 0.50),
        (Kind.VEHICLE, "collision-vehicle", 0.60),
        (Kind.CYCLIST, "collision-vehicle", 0.60),
        (Kind.STATIC, "collision-static", 0.65),
    ],
)
def test_a_collision_costs_by_what_was_hit(kind: Kind, name: str, factor: float) -> None:
    found = record(arriving(), End.ARRIVED, {20: [hit("0", "a", kind)]})
    assert [(i.kind, i.tick, i.x, i.y, i.factor, i.other) for i in found.infractions] == [
        (name, 20, 10.0, 0.0, factor, "a")
    ]
    assert (found.rc, found.ip) == (100.0, factor)


def test_both_cavs_of_a_pair_pay() -> None:
    about = scenario(ego("0"), ego("1", y=20.0))
    both = {5: [hit("0", "1"), hit("1", "0")]}
    drives = {"0": arriving(), "1": arriving(y=20.0)}
    on = roads(lane("a", (-50, 0), (150, 0)), lane("b", (-50, 20), (150, 20)))
    found = build_ego_records(episode(about, drives, {"0": End.ARRIVED, "1": End.ARRIVED}, both), about, on)
    assert [(one.ip, one.infractions[0].other) for one in found] == [(0.6, "1"), (0.6, "0")]


def hits_of(*ticks_and_others: tuple[int, str]) -> dict[int, list[object]]:
    return {tick: [hit("0", other)] for tick, other in ticks_and_others}


def collision_ticks(rows: Sequence[Row], *ticks_and_others: tuple[int, str]) -> list[int]:
    return [tick for _, tick in events(record(rows, hits=hits_of(*ticks_and_others)))]


def test_touching_on_is_one_collision() -> None:
    assert collision_ticks(straight(60, speed=0.0), *((tick, "a") for tick in range(10, 60))) == [10]


def test_the_same_actor_counts_again_after_more_than_5_s() -> None:
    """Tick 100 is exactly 5 s after the first hit; the places are 50 m and more apart."""
    assert collision_ticks(straight(180), (0, "a"), (60, "a"), (100, "a"), (101, "a")) == [0, 101]


def test_the_5_s_begin_at_the_counted_hit_not_at_an_ignored_one() -> None:
    assert collision_ticks(straight(180), (0, "a"), (90, "a"), (150, "a")) == [0, 150]


def test_another_actor_counts_more_than_3_m_further() -> None:
    """Tick 6 is 3.0 m, tick 7 3.5 m from the first place."""
    assert collision_ticks(straight(20), (0, "a"), (6, "b")) == [0]
    assert collision_ticks(straight(20), (0, "a"), (7, "b")) == [0, 7]


def test_only_the_last_counted_actor_is_remembered() -> None:
    assert collision_ticks(straight(60), (0, "a"), (10, "b"), (20, "a"), (30, "a")) == [0, 10, 20]


def test_the_map_is_never_the_last_actor() -> None:
    assert collision_ticks(straight(60), (0, ""), (10, ""), (20, "")) == [0, 10, 20]
    assert collision_ticks(straight(60), (0, "a"), (10, ""), (20, "a")) == [0, 10]


@pytest.mark.parametrize(("away", "counted"), [(5.0, [0]), (5.5, [0, 24])])
def test_a_place_is_forgotten_more_than_5_m_away(away: float, counted: list[int]) -> None:
    """Out to `away` m and back to the first place, where b is hit in tick 24."""
    rows = [(away * min(tick, 24 - tick) / 12, 0.0, 0.0, 1.0) for tick in range(25)]
    assert collision_ticks(rows, (0, "a"), (24, "b")) == counted


def test_a_collision_counts_between_completion_and_leaving() -> None:
    found = record(arriving(), End.ARRIVED, {202: [hit("0", "a")]})
    assert (found.rc, events(found)) == (100.0, [("collision-vehicle", 202)])


def test_factors_multiply() -> None:
    hits = {0: [hit("0", "a")], 40: [hit("0", "b", Kind.PEDESTRIAN)], 80: [hit("0", "", Kind.STATIC)]}
    assert record(arriving(), End.ARRIVED, hits).ip == pytest.approx(0.60 * 0.50 * 0.65)
