"""Collisions (protocol 7.2), with expectations worked out by hand; impact speeds also against an oracle."""

import cmath
import math
from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.sampling import examples
from testing.score_golden import (
    Row,
    actor,
    arriving,
    ego,
    episode,
    hit,
    lane,
    roads,
    scenario,
    straight,
    street,
)
from testing.scored_records import events, record

from mdrive_sumo.core.state import Actors, End, Kind
from mdrive_sumo.scoring.metrics import ScoredEpisode, build_ego_records


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
    found = build_ego_records(
        ScoredEpisode(episode(about, drives, {"0": End.ARRIVED, "1": End.ARRIVED}, both), about, on)
    )
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


def test_a_wall_renews_the_memory_of_the_last_actor() -> None:
    """5 s count from the last hit of any kind: from the wall in tick 60, not from a in tick 0."""
    assert collision_ticks(straight(240, speed=5.0), (0, "a"), (60, ""), (110, "a"), (160, "a")) == [0, 60]
    assert collision_ticks(straight(240, speed=5.0), (0, "a"), (60, ""), (110, "a"), (161, "a")) == [0, 60, 161]


def test_a_wall_does_not_recall_a_forgotten_actor() -> None:
    assert collision_ticks(straight(240, speed=5.0), (0, "a"), (101, ""), (120, "a")) == [0, 101, 120]


def test_ego_1_of_i12_pays_once_for_the_car_that_it_pushes_along_the_walls() -> None:
    """Found by a second scorer: IP 0.140 by the original's rule, 0.084 where only road users renew the memory.

    Places and ticks of the contacts of `constant-speed` in i12_ins_sl_old_town, seed 0; 15.1 % of its way was outside
    lanes. The CAV hits ego 0, then two walls, and ego 0 again 5.05 s after the first time but 0.55 s after a wall.
    """
    hits = {92: (-4.59, -0.08, "0"), 155: (7.13, -7.21, ""), 182: (15.27, -3.0, ""), 193: (18.68, 1.12, "0")}
    hits[201] = (20.34, 4.86, "")
    at = {tick: (x, y) for tick, (x, y, _) in hits.items()}
    rows = [(*at[min(t for t in hits if t >= min(tick, 201))], 0.0, 1.0) for tick in range(240)]
    kinds = {tick: Kind.VEHICLE if other else Kind.STATIC for tick, (*_, other) in hits.items()}
    found = record(rows, hits={tick: [hit("0", other, kinds[tick])] for tick, (*_, other) in hits.items()})
    collisions = [i for i in found.infractions if i.kind.startswith("collision")]
    assert [i.tick for i in collisions] == [92, 155, 182, 201]
    assert math.prod(i.factor for i in collisions) * 0.8485 == pytest.approx(0.140, abs=5e-4)


def count_by_the_rule(rows: Sequence[Row], contacts: dict[int, list[str]]) -> list[tuple[int, str]]:
    """Return ticks and others of the collisions by the steps of the original's sensor, one after the other.

    Sensor: (1) same id as the last: return. (2) nearer than 3 m to a registered place: return. (3) register place and
    time. (4) unless the id is 0, that of the map, it becomes the last. Criterion, each tick: drop places beyond 5 m;
    drop the last id once 5 s have passed since the registered time. The sensor reports before the criterion's tick.
    """
    last_id, registered_s, places, registered = None, 0.0, [], []
    for tick, (x, y, _, _) in enumerate(rows):
        for other in contacts.get(tick, []):
            if last_id is not None and last_id == other:
                continue
            if [p for p in places if (p[0] - x) ** 2 + (p[1] - y) ** 2 <= 3.0**2]:
                continue
            places.append((x, y))
            registered_s = tick * 0.05
            registered.append((tick, other))
            if other != "":
                last_id = other
        places = [p for p in places if (p[0] - x) ** 2 + (p[1] - y) ** 2 <= 5.0**2]
        if (tick + 1) * 0.05 - registered_s > 5.0 + 1e-9:
            last_id = None
    return registered


@pytest.mark.slow
@settings(max_examples=examples(15, 100))
@given(
    st.dictionaries(st.integers(0, 399), st.lists(st.sampled_from(["", "a", "b"]), max_size=2, unique=True)),
    st.sampled_from([1.02, 2.06, 4.14, 10.06]),
    st.sampled_from([4.0, 6.0, 8.0, 14.0]),
)
def test_collisions_are_those_of_the_rule_step_by_step(
    contacts: dict[int, list[str]], speed: float, reach: float
) -> None:
    """A drive to and fro within `reach` m: places are left and met again, and no two are exactly 3 or 5 m apart."""
    way = [round(reach - abs(speed * tick / 20 % (2 * reach) - reach), 3) for tick in range(400)]
    rows = [(x, 0.0, 0.0, speed) for x in way]
    hits = {tick: [hit("0", other) for other in others] for tick, others in contacts.items()}
    found = [(i.tick, i.other) for i in record(rows, hits=hits).infractions if i.kind.startswith("collision")]
    assert found == count_by_the_rule(rows, contacts)


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


def impact_speeds(rows: list[Row], tick: int, other: str = "npc", actors: Actors | None = None) -> list[float | None]:
    about = scenario(ego("0"))
    recorded = episode(about, {"0": rows}, {"0": End.AGENT_FAILED}, {tick: [hit("0", other)]}, actors)
    (record,) = build_ego_records(ScoredEpisode(recorded, about, street()))
    return [found.impact_speed for found in record.infractions if found.kind.startswith("collision")]


def test_the_speed_is_that_of_the_tick_before_the_contact() -> None:
    """10 m/s until tick 19, and 2 m/s from the contact in tick 20 on, as the impulse leaves it."""
    rows = [*straight(20), *((10.0 + 0.1 * i, 0.0, 0.0, 2.0) for i in range(1, 10))]
    assert impact_speeds(rows, 20, actors=actor(14.0, 0.0)) == [10.0]


@pytest.mark.parametrize(
    ("speed", "yaw", "relative"),
    [(0.0, 0.0, 10.0), (4.0, 0.0, 6.0), (10.0, 0.0, 0.0), (5.0, cmath.pi, 15.0), (10.0, cmath.pi / 2, 14.142)],
)
def test_the_velocity_of_the_other_counts_as_a_vector(speed: float, yaw: float, relative: float) -> None:
    assert impact_speeds(straight(30), 20, actors=actor(14.0, 0.0, yaw, speed)) == [pytest.approx(relative, abs=1e-3)]


def test_a_wall_stands() -> None:
    assert impact_speeds(straight(30), 20, other="") == [10.0]


def test_a_contact_in_the_first_tick_has_the_speed_of_that_tick() -> None:
    assert impact_speeds(straight(30), 0, actors=actor(4.0, 0.0)) == [10.0]


def test_infractions_other_than_collisions_have_no_impact_speed() -> None:
    about = scenario(ego("0"))
    recorded = episode(about, {"0": straight(602, speed=0.0)}, {"0": End.BLOCKED})
    (record,) = build_ego_records(ScoredEpisode(recorded, about, street()))
    assert record.infractions and all(found.impact_speed is None for found in record.infractions)


@given(st.floats(-5, 20), st.floats(-3, 3), st.floats(-5, 20), st.floats(-3, 3))
def test_the_oracle_agrees(own: float, own_yaw: float, other: float, other_yaw: float) -> None:
    (found,) = impact_speeds([(0.0, 0.0, own_yaw, own)] * 3, 2, actors=actor(4.0, 0.0, other_yaw, other))
    assert found == pytest.approx(abs(cmath.rect(own, own_yaw) - cmath.rect(other, other_yaw)), abs=0.01)
