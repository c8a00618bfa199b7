"""Scripted actors: motion along their paths, and stopping for obstacles."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from testing.actors_world import Film, actor, no_egos, standing_car, two_lanes
from testing.sampling import examples, sampled
from testing.worlds import straight_road

from mdrive_sumo.actors import ActorMode
from mdrive_sumo.core.state import Actors, EgoState, Kind
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import LaneMotion

pytestmark = pytest.mark.slow

AHEAD = [(0.0, 0.0), (100.0, 0.0)]


def test_a_prop_stands_with_its_size_and_class() -> None:
    film = Film(actor("cone", "static", at=(5, 2), yaw=0.5), seconds=1)
    first, last = film.frames[0], film.frames[-1]
    assert last.ids == ("cone",)
    assert last.kind.tolist() == [Kind.STATIC]
    assert (last.x[0], last.y[0], last.yaw[0], last.speed[0]) == (5.0, 2.0, 0.5, 0.0)
    assert (last.length[0], last.width[0]) == (0.5, 0.5)
    assert first.ids is last.ids


def test_a_vehicle_speeds_up_to_its_target_and_stops_at_the_end_of_its_path() -> None:
    x, y, yaw, v = Film(actor("v", "vehicle", points=AHEAD, speed=8), seconds=30).of("v").T
    assert v.max() == pytest.approx(8.0)
    assert np.diff(v).max() * 20 <= 2.6 + 1e-9
    assert np.diff(v).min() * 20 >= -3.5
    assert x[-1] == pytest.approx(100.0, abs=0.05)
    assert v[-1] == 0.0
    assert np.abs(np.diff(x) * 20 - v[1:]).max() < 1e-6
    assert not y.any()
    assert not yaw.any()


def test_a_pedestrian_walks_on_behind_its_last_point_and_turns_within_a_step() -> None:
    film = Film(actor("p", "pedestrian", points=[(0, 0), (3, 0), (3, 3)], speed=1.5), seconds=20)
    x, y, yaw, v = film.of("p").T
    assert v[-1] == 1.5
    assert y[-1] > 20.0
    assert x[-1] == pytest.approx(3.0)
    straight = np.minimum(np.abs(yaw), np.abs(yaw - math.pi / 2)) < 1e-6
    assert (~straight).sum() <= 4  # 0.2 m at 1.5 m/s


def test_a_vehicle_turns_as_long_as_its_axles_do_and_its_middle_follows_the_path_literally() -> None:
    film = Film(actor("v", "vehicle", points=[(0, 0), (20, 0), (20, 20)], speed=5), seconds=12)
    x, y, yaw, _ = film.of("v").T
    assert max(abs(np.minimum(np.abs(y), np.abs(x - 20.0)))) < 1e-9
    assert np.abs(np.diff(yaw)).max() < math.radians(15)
    assert 0 < yaw[np.argmax(x > 19.5)] < math.pi / 2
    assert yaw[-1] == pytest.approx(math.pi / 2)


def test_along_lanes_it_comes_from_its_start_onto_the_centre_line_and_changes_lanes() -> None:
    lanes = LaneMotion(lanes=("r_0", "r_1"), speed=10, start_speed=10)
    car = actor("v", "vehicle", at=(20, 1.0)).model_copy(update={"motion": lanes})
    x, y, _, v = Film(car, seconds=25, roads=two_lanes()).of("v").T
    assert (x[0], y[0], v[0]) == (pytest.approx(20.0), pytest.approx(1.0), 10.0)
    assert y[np.argmax(x > 60)] == pytest.approx(0.0, abs=1e-6)  # on the first lane
    assert y[-1] == pytest.approx(3.5)  # on the second
    assert np.abs(np.diff(y)).max() < 0.15


def test_a_replay_is_linear_between_poses_turns_the_shortest_way_and_leaves() -> None:
    poses = [(1.0, 0.0, 0.0, 3.0), (2.0, 10.0, 0.0, -3.0), (3.0, 12.0, 0.0, -3.0)]
    film = Film(actor("r", "vehicle", poses=poses), seconds=4)
    x, _, yaw, v = film.of("r").T
    assert np.isnan(x[:20]).all()
    assert not np.isnan(x[20:61]).any()
    assert np.isnan(x[61:]).all()
    assert x[30] == pytest.approx(5.0)
    assert math.cos(yaw[30]) == pytest.approx(-1.0)  # over pi, not through 0
    assert v[30] == pytest.approx(10.0)
    assert v[50] == pytest.approx(2.0)
    stays = Film(actor("r", "vehicle", poses=poses, stays=True), seconds=4).of("r")
    assert stays[-1].tolist() == [12.0, 0.0, -3.0 + 2 * math.pi, 0.0]


def test_a_walker_of_a_log_stops_for_a_blocked_path_and_then_goes_on_on_its_own_clock() -> None:
    poses = [(t / 10, 50.0, -8.0 + 0.14 * t, math.pi / 2) for t in range(120)]
    free = Film(actor("p", "pedestrian", poses=poses, stays=True), seconds=12).of("p")
    assert np.abs(free[:-20, 1] - (-8.0 + 1.4 * np.arange(len(free) - 20) / 20)).max() < 1e-9
    blocked = Film(
        actor("p", "pedestrian", poses=poses, stays=True), seconds=30, egos=standing_car(50, 0, until=300)
    ).of("p")
    y, v = blocked[:, 1], blocked[:, 3]
    assert v[200:300].max() == 0.0
    assert -1.4 - 0.925 < y[299] < -0.925 - 0.25  # within a metre and a half of the car's side, and outside
    assert v[400] == pytest.approx(1.4)
    assert y[-1] == pytest.approx(poses[-1][2])
    assert np.abs(np.diff(v[:400])).max() * 20 <= 4.0 + 1e-9


def test_people_on_foot_do_not_stop_for_a_car_that_merely_comes() -> None:
    walker = actor("p", "pedestrian", points=[(50, -8), (50, 8)], speed=1.5)
    coming = Film(walker, seconds=10, egos=lambda tick: {"0": EgoState(tick * 0.2 - 10, 0.0, 0.0, 4.0)}).of("p")
    alone = Film(walker, seconds=10).of("p")
    assert np.array_equal(coming, alone)


@pytest.mark.parametrize("what", ["cav", "background", "prop", "pedestrian", "vehicle"])
def test_a_vehicle_brakes_comfortably_before_whatever_stands_in_its_way(what: str) -> None:
    props = {kind: [actor("x", kind, at=(80, 0))] for kind in ("static", "pedestrian", "vehicle")}
    others = {"prop": props["static"], "pedestrian": props["pedestrian"], "vehicle": props["vehicle"]}.get(what, [])
    one = np.ones(1)
    car = Actors(("b",), np.zeros(1, np.uint8), 80 * one, 0 * one, 0 * one, 0 * one, 4.6 * one, 1.8 * one)
    film = Film(
        actor("v", "vehicle", points=[(0, 0), (200, 0)], speed=10),
        *others,
        egos=standing_car(80, 0) if what == "cav" else no_egos,
        background=car if what == "background" else None,
    )
    x, _, _, v = film.of("v").T
    half = {"prop": 0.25, "pedestrian": 0.25, "cav": 2.46}.get(what, 2.3)
    assert v[-1] == 0.0
    assert 1.5 < 80 - half - (x[-1] + 2.3) < 3.0
    assert np.diff(v).min() * 20 > -5.0


def test_it_goes_on_when_the_way_is_free_again() -> None:
    film = Film(actor("v", "vehicle", points=AHEAD, speed=8), seconds=40, egos=standing_car(50, 0, until=300))
    v = film.of("v")[:, 3]
    assert v[250:300].max() < 0.05
    assert v[400:].max() == pytest.approx(8.0)


def test_what_jumps_in_front_of_it_is_braked_for_with_all_it_has() -> None:
    film = Film(
        actor("v", "vehicle", points=[(0, 0), (200, 0)], speed=12, start_speed=12),
        egos=lambda tick: {"0": EgoState(48.0 if tick >= 40 else 500.0, 0.0, 0.0, 0.0)},
    )
    x, _, _, v = film.of("v").T
    assert np.diff(v).min() * 20 == pytest.approx(-8.0)
    assert x[-1] + 2.3 < 48.0 - 2.4


def test_what_is_behind_or_beside_does_not_matter() -> None:
    alone = Film(actor("v", "vehicle", points=AHEAD, speed=8)).of("v")
    film = Film(
        actor("v", "vehicle", points=AHEAD, speed=8),
        actor("behind", "vehicle", at=(-4.7, 0)),
        actor("beside", "vehicle", at=(40, 2.5)),
    )
    assert np.array_equal(film.of("v"), alone)


def test_one_that_follows_keeps_behind_and_goes_as_fast() -> None:
    film = Film(
        actor("lead", "vehicle", points=[(20, 0), (300, 0)], speed=5, start_speed=5),
        actor("a", "vehicle", points=[(0, 0), (300, 0)], speed=12, start_speed=12),
    )
    lead, a = film.of("lead"), film.of("a")
    assert (lead[:, 0] - a[:, 0]).min() > 4.6
    assert a[-1, 3] == pytest.approx(5.0, abs=0.2)


@pytest.mark.parametrize("offset", sampled((-6.0, -3.0, 0.0, 3.0, 6.0), (-3.0, 0.0, 6.0)))
def test_two_whose_ways_cross_both_get_through_without_touching(offset: float) -> None:
    film = Film(
        actor("a", "vehicle", points=[(-40 + offset, 0), (80, 0)], speed=8, start_speed=8),
        actor("b", "vehicle", points=[(0, -40), (0, 80)], speed=8, start_speed=8),
        seconds=40,
    )
    a, b = film.of("a"), film.of("b")
    assert a[-1, 0] == pytest.approx(80.0, abs=0.1)
    assert b[-1, 1] == pytest.approx(80.0, abs=0.1)
    apart = np.maximum(np.abs(a[:, 0] - b[:, 0]), np.abs(a[:, 1] - b[:, 1]))
    assert apart.min() > (4.6 + 1.9) / 2 - 1e-6


def test_noses_in_each_others_way_do_not_wait_for_each_other_for_ever() -> None:
    film = Film(
        actor("a", "vehicle", points=[(-2.6, 0), (60, 0)], speed=5),
        actor("b", "vehicle", points=[(0, -2.6), (0, 60)], speed=5),
        seconds=40,
    )
    assert film.of("a")[-1, 0] == pytest.approx(60.0, abs=0.1)
    assert film.of("b")[-1, 1] == pytest.approx(60.0, abs=0.1)


def test_a_walker_and_a_car_face_to_face_do_not_wait_for_each_other_for_ever() -> None:
    film = Film(
        actor("a", "vehicle", points=[(0, 0), (60, 0)], speed=5),
        actor("p", "pedestrian", points=[(3.0, 0), (-60, 0)], speed=1.5),
        seconds=40,
    )
    assert film.of("a")[-1, 0] == pytest.approx(60.0, abs=0.1)
    assert film.of("p")[-1, 0] < -40.0


def test_a_log_is_not_held_up_by_itself() -> None:
    def poses(y: float) -> list[tuple[float, float, float, float]]:
        return [(t / 10, 0.4 * t, y, 0.0) for t in range(100)]

    beside = [(t, x + 0.9, y, yaw) for t, x, y, yaw in poses(0.1)]
    bikes = [actor("a", "cyclist", poses=poses(0.0)), actor("b", "cyclist", poses=beside)]
    parked = actor("parked", "vehicle", at=(20.0, 1.2))
    x = Film(*bikes, parked, seconds=9.5).of("a")[:, 0]
    assert np.abs(x - 0.2 * np.arange(len(x))).max() < 1e-9


def test_the_original_mode_avoids_nothing_and_freezes_when_the_first_cav_ends() -> None:
    def gone(tick: int) -> dict[str, EgoState]:
        car = {"1": EgoState(500.0, 0.0, 0.0, 0.0)}
        return car if tick >= 100 else {"0": EgoState(50.0, 0.0, 0.0, 0.0), **car}

    car = actor("v", "vehicle", points=[(0, 0), (200, 0)], speed=12, start_speed=12)
    film = Film(car, egos=gone, mode=ActorMode.ORIGINAL, seconds=10).of("v")
    assert film[100, 0] == pytest.approx(60.0)  # right through the CAV
    assert film[-1, 0] == film[100, 0]
    assert film[-1, 3] == 0.0
    default = Film(car, egos=gone, seconds=10).of("v")
    assert default[100, 0] < 50.0
    assert default[-1, 3] > 0.0  # a global clock


def test_one_that_does_not_avoid_goes_on_through() -> None:
    car = actor("v", "vehicle", points=AHEAD, speed=10, avoid_collision=False)
    assert Film(car, egos=standing_car(50, 0)).of("v")[-1, 0] == pytest.approx(100.0, abs=0.05)


def test_a_struck_one_stands_for_two_seconds() -> None:
    car = actor("v", "vehicle", points=[(0, 0), (200, 0)], speed=10, start_speed=10)
    v = Film(car, seconds=10, struck=lambda tick: {"v"} if tick == 40 else set()).of("v")[:, 3]
    assert v[40] == 10.0
    assert not v[41:81].any()
    assert v[82] > 0.0


def test_a_replay_does_not_appear_inside_a_cav() -> None:
    poses = [(t / 10, 50.0 + 0.4 * t, 0.0, 0.0) for t in range(10, 100)]
    x = Film(actor("r", "vehicle", poses=poses), egos=standing_car(54, 0, until=100), seconds=8).of("r")[:, 0]
    assert np.isnan(x[:101]).all()
    assert x[105] == pytest.approx(54.0, abs=1.0)
    original = Film(
        actor("r", "vehicle", poses=poses), egos=standing_car(54, 0), mode=ActorMode.ORIGINAL, seconds=8
    ).of("r")[:, 0]
    assert not np.isnan(original[21])


@settings(max_examples=examples(8, 100))
@given(order=st.permutations(["a", "b", "c"]), seconds=st.integers(2, 5))
def test_the_order_in_the_file_does_not_matter(order: list[str], seconds: int) -> None:
    cast = {
        "a": actor("a", "vehicle", points=AHEAD, speed=8),
        "b": actor("b", "cyclist", points=[(30, -8), (30, 20)], speed=4),
        "c": actor("c", "pedestrian", points=[(20, -5), (20, 5)], speed=1.5),
    }
    film = Film(*(cast[name] for name in order), seconds=seconds)
    again = Film(*cast.values(), seconds=seconds)
    for name in cast:
        assert np.array_equal(film.of(name), again.of(name))


def test_a_route_of_lanes_that_do_not_connect_is_refused() -> None:
    lanes = LaneMotion(lanes=("r_0", "r_9"), speed=10)
    car = actor("v", "vehicle", at=(20, 0)).model_copy(update={"motion": lanes, "start": Pose(x=20, y=0, yaw=0)})
    with pytest.raises(Exception, match="r_9"):
        Film(car, roads=straight_road(), seconds=1)
