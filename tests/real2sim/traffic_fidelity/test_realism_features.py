"""Features of motion with known values: speeds, turns, distances between boxes, who follows whom."""

import numpy as np
import pytest
import shapely
from hypothesis import given
from hypothesis import strategies as st
from shapely.affinity import translate
from testing.fit_crossing import crossing

from mdrive_sumo.core.geometry import Float, box_corners
from mdrive_sumo.roads import RoadMap
from real2sim.traffic_fidelity.realism_features import (
    MOST_GAP_M,
    MOST_TTC_S,
    RoadUserStates,
    compute_features,
    find_collisions,
)

DT_S = 0.1
TIME = np.arange(21) * DT_S
CAR = (4.0, 2.0)


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return crossing(tmp_path_factory.mktemp("crossing"))


def states(*users: tuple[object, object, object], size: tuple[float, float] = CAR) -> RoadUserStates:
    """Road users of one size with x, y, yaw, each a number or (T,)."""
    full = np.ones(len(TIME))
    x, y, yaw = (np.column_stack([np.asarray(user[k]) * full for user in users]) for k in range(3))
    lengths, widths = (np.full(len(users), one) for one in size)
    return RoadUserStates(x, y, yaw, lengths, widths, DT_S)


def features(roads: RoadMap, some: RoadUserStates, *judged: int) -> dict[str, Float]:
    return dict(compute_features(some, np.array(judged or range(some.x.shape[1])), roads))


def test_speed_acceleration_and_turn_rate_are_central_differences(roads: RoadMap) -> None:
    found = features(roads, states((50 + 2 * TIME + 1.5 * TIME * TIME, 0.0, 3.1 + 0.5 * TIME)))
    assert found["speed"][1:-1, 0] == pytest.approx(2 + 3 * TIME[1:-1])
    assert found["acceleration"][2:-2, 0] == pytest.approx(3.0)
    assert found["turn_rate"][1:-1, 0] == pytest.approx(0.5)  # past pi as well
    assert found["turn_acceleration"][2:-2, 0] == pytest.approx(0.0, abs=1e-9)
    assert np.isnan(found["speed"][[0, -1], 0]).all()


def test_the_lateral_offset_is_the_distance_from_the_centre_of_the_lane(roads: RoadMap) -> None:
    found = features(roads, states((50 + 10 * TIME, 0.7, 0.0)))
    assert found["lateral_offset"][:, 0] == pytest.approx(0.7)


def test_a_follower_has_the_gap_between_the_bumpers_and_the_time_in_which_it_closes(roads: RoadMap) -> None:
    found = features(roads, states((50 + 10 * TIME, 0.0, 0.0), (70 + 5 * TIME, 0.3, 0.0)))
    assert found["gap"][0] == pytest.approx([16.0, MOST_GAP_M])
    assert found["ttc"][10] == pytest.approx([(16.0 - 5 * TIME[10]) / 5, MOST_TTC_S])
    assert found["nearest"][0] == pytest.approx([16.0, 16.0])


@pytest.mark.parametrize("other", [(70.0, 3.5, 0.0), (30.0, 0.0, 0.0), (70.0, 0.0, np.pi)], ids=str)
def test_beside_behind_and_oncoming_are_not_followed(roads: RoadMap, other: tuple[float, float, float]) -> None:
    found = features(roads, states((50 + 10 * TIME, 0.0, 0.0), other), 0)
    assert found["gap"][0, 0] == MOST_GAP_M
    assert found["ttc"][10, 0] == MOST_TTC_S


def test_where_a_road_user_is_absent_there_is_no_sample_and_nothing_near_it(roads: RoadMap) -> None:
    seen = np.where(TIME < 1.0, 1.0, np.nan)
    found = features(roads, states(((50 + 10 * TIME) * seen, 0.0 * seen, 0.0 * seen), (70 + 10 * TIME, 0.0, 0.0)))
    for name, values in found.items():
        assert np.isnan(values[12:, 0]).all(), name
    assert found["nearest"][12, 1] == MOST_GAP_M
    assert not find_collisions(found).any()


Spot = tuple[float, float, float]
poses = st.tuples(st.floats(-9, 9), st.floats(-9, 9), st.floats(-4, 4))


@given(poses, poses)
def test_the_distance_is_that_of_the_boxes_and_negative_where_they_overlap(roads: RoadMap, a: Spot, b: Spot) -> None:
    found = features(roads, states(a, b), 0)["nearest"][0, 0]
    one, other = (shapely.Polygon(box_corners(*pose, *CAR)) for pose in (a, b))
    apart = float(one.distance(other))
    if apart > 0:
        assert found == pytest.approx(apart, abs=1e-6)
    else:
        assert found <= 1e-6
        shift = -found + 1e-6  # moved apart by the depth along some axis, they only touch
        moved = [
            translate(other, shift * np.cos(turn), shift * np.sin(turn))
            for pose in (a, b)
            for turn in pose[2] + np.arange(4) * np.pi / 2
        ]
        assert min(float(one.intersection(polygon).area) for polygon in moved) < 1e-4
