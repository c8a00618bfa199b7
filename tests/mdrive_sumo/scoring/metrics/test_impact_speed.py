"""Impact speeds of collisions, from frames made by hand and against an oracle with complex numbers."""

import cmath

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.score_golden import Row, actor, ego, episode, hit, scenario, straight, street

from mdrive_sumo.core.state import Actors, End
from mdrive_sumo.scoring.metrics import build_ego_records


def impact_speeds(rows: list[Row], tick: int, other: str = "npc", actors: Actors | None = None) -> list[float | None]:
    about = scenario(ego("0"))
    recorded = episode(about, {"0": rows}, {"0": End.AGENT_FAILED}, {tick: [hit("0", other)]}, actors)
    (record,) = build_ego_records(recorded, about, street())
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
    (record,) = build_ego_records(recorded, about, street())
    assert record.infractions and all(found.impact_speed is None for found in record.infractions)


@given(st.floats(-5, 20), st.floats(-3, 3), st.floats(-5, 20), st.floats(-3, 3))
def test_the_oracle_agrees(own: float, own_yaw: float, other: float, other_yaw: float) -> None:
    (found,) = impact_speeds([(0.0, 0.0, own_yaw, own)] * 3, 2, actors=actor(4.0, 0.0, other_yaw, other))
    assert found == pytest.approx(abs(cmath.rect(own, own_yaw) - cmath.rect(other, other_yaw)), abs=0.01)
