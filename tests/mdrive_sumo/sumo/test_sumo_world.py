"""Contract with SUMO: ego poses, reactions of the background traffic, and that no vehicle vanishes."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.sumo_crossing import SIZE, car, compiled, overlap, scenario

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.core.state import DT, STRUCK_HOLD_TICKS, Actors, EgoState
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.sumo import SumoWorld
from mdrive_sumo.sumo.sumo_frames import compute_front_bumper, convert_sumo_angles, convert_yaw_to_sumo

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return compiled(tmp_path_factory.mktemp("cross"), "priority")


@pytest.fixture(scope="module")
def lit_roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return compiled(tmp_path_factory.mktemp("lit"), "traffic_light")


def standing(roads: RoadMap, ego: EgoState, *vehicles: BackgroundVehicle, ticks: int = 600) -> tuple[int, Actors]:
    """Ticks with an overlap while the ego stands, and the actors at the end."""
    overlaps = 0
    with SumoWorld(scenario(*vehicles), roads, {"e": SIZE}, seed=1) as world:
        around = world.start({"e": ego}, Actors.empty())
        for _ in range(ticks):
            overlaps += overlap(ego, around.actors)
            around = world.advance({"e": ego}, Actors.empty(), ())
    return overlaps, around.actors


@given(st.floats(-math.pi, math.pi))
def test_headings_round_trip(yaw: float) -> None:
    found = float(convert_sumo_angles(np.array([convert_yaw_to_sumo(yaw)]))[0])
    assert -math.pi <= found < math.pi
    assert math.isclose(wrap_angle(found - yaw), 0.0, abs_tol=1e-9)


def test_sumo_says_ninety_degrees_for_east_and_the_nose_for_the_position() -> None:
    assert convert_sumo_angles(np.array([90.0, 0.0])).tolist() == pytest.approx([0.0, math.pi / 2])
    assert compute_front_bumper(10.0, 5.0, 0.0, 4.0) == pytest.approx((12.0, 5.0))


def test_background_poses_are_box_centres(roads: RoadMap) -> None:
    with SumoWorld(scenario(car("bg", pos=20.0, speed=0.0)), roads, {"e": SIZE}, seed=1) as world:
        actors = world.start({"e": EgoState(0, 100, 0, 0)}, Actors.empty()).actors
    assert actors.ids == ("bg",)
    assert actors.yaw[0] == pytest.approx(0.0, abs=1e-6)
    assert actors.y[0] == pytest.approx(-4.8, abs=0.01)
    assert actors.x[0] == pytest.approx(-150 + 20 - 2.5, abs=0.05)  # departPos is the nose of a car of 5 m
    assert (actors.length[0], actors.width[0]) == (5.0, 1.8)


@pytest.mark.parametrize("action_step_s", [0.05, 0.5])
def test_a_follower_stops_behind_a_standing_ego(roads: RoadMap, action_step_s: float) -> None:
    ego, overlaps = EgoState(-60.0, -4.8, 0.0, 0.0), 0
    with SumoWorld(scenario(car("bg"), action_step_s=action_step_s), roads, {"e": SIZE}, seed=1) as world:
        around = world.start({"e": ego}, Actors.empty())
        for _ in range(300):
            overlaps += overlap(ego, around.actors)
            around = world.advance({"e": ego}, Actors.empty(), ())
    assert overlaps == 0
    # SUMO lets it pass on the free lane in the end, or it stands behind: either way it has reacted


def test_a_follower_keeps_its_distance_to_a_slow_ego(roads: RoadMap) -> None:
    overlaps, seen = 0, []
    with SumoWorld(scenario(car("bg", edges=("c", "d"))), roads, {"e": SIZE}, seed=1) as world:
        y = -115.0
        around = world.start({"e": EgoState(1.6, y, math.pi / 2, 4.0)}, Actors.empty())
        lane_x = float(around.actors.x[0])
        for _ in range(400):
            ego = EgoState(lane_x, y, math.pi / 2, 4.0)
            overlaps += overlap(ego, around.actors)
            seen.append(float(around.actors.speed[0]))
            y += 4.0 * DT
            around = world.advance({"e": ego}, Actors.empty(), ())
    assert overlaps == 0
    assert seen[0] > 10.0
    assert seen[-1] == pytest.approx(4.0, abs=0.7)


@pytest.mark.parametrize(
    ("ego", "lane"),
    [
        (EgoState(-60.0, -3.2, 0.0, 0.0), 0),  # straddles the marking
        (EgoState(-60.0, -3.2, 0.0, 0.0), 1),
        (EgoState(-60.0, -3.6, 0.0, 0.0), 1),  # mostly on lane 0, reaches into what lane 1 sweeps
        (EgoState(-60.0, -4.0, math.radians(60), 0.0), 0),
        (EgoState(-60.0, -4.0, math.radians(60), 0.0), 1),
        (EgoState(-60.0, -3.2, math.pi / 2, 0.0), 0),  # stands across both lanes
        (EgoState(-60.0, -3.2, math.pi / 2, 0.0), 1),
    ],
)
def test_no_vehicle_drives_through_an_ego_that_straddles_or_stands_across(
    roads: RoadMap, ego: EgoState, lane: int
) -> None:
    overlaps, actors = standing(roads, ego, car("bg", lane=lane), ticks=400)
    assert overlaps == 0
    if ego.yaw == math.pi / 2:
        assert actors.x[0] < ego.x  # both lanes are blocked: no vehicle gets past
        assert actors.speed[0] < 0.1


def test_an_ego_half_a_metre_inside_a_lane_edge_does_not_stop_vehicles_that_it_does_not_touch(roads: RoadMap) -> None:
    ego = EgoState(-60.0, -4.8 + 0.3, 0.0, 0.0)  # its side is 0.9 m from the other car's corridor
    overlaps, actors = standing(roads, ego, car("bg", lane=1), ticks=200)
    assert overlaps == 0
    assert "bg" in actors.ids
    assert actors.x[0] > ego.x + 10


def test_crossing_traffic_yields_to_an_ego_that_stands_in_the_junction(roads: RoadMap) -> None:
    ego = EgoState(0.0, -2.0, 0.0, 0.0)
    overlaps, actors = standing(roads, ego, car("bg", edges=("c", "d"), pos=60.0), ticks=400)
    assert overlaps == 0
    assert actors.y[0] < ego.y


def test_ghosts_and_egos_are_never_actors_and_leave_with_their_ego(roads: RoadMap) -> None:
    ego = EgoState(-60.0, -3.2, 0.0, 0.0)
    with SumoWorld(scenario(car("bg")), roads, {"e": SIZE}, seed=1) as world:
        around = world.start({"e": ego}, Actors.empty())
        for _ in range(200):
            assert around.actors.ids == ("bg",)
            around = world.advance({"e": ego}, Actors.empty(), ())
        assert around.actors.speed[0] < 5.0
        for _ in range(100):
            around = world.advance({}, Actors.empty(), ())
        assert around.actors.speed[0] > 5.0


def test_a_struck_vehicle_is_held_for_two_seconds(roads: RoadMap) -> None:
    away = {"e": EgoState(0, 120, 0, 0)}
    with SumoWorld(scenario(car("bg")), roads, {"e": SIZE}, seed=1) as world:
        before = world.start(away, Actors.empty()).actors
        speeds = [
            float(world.advance(away, Actors.empty(), ("bg",) if i == 0 else ()).actors.speed[0])
            for i in range(STRUCK_HOLD_TICKS + 20)
        ]
    assert before.speed[0] > 11.0
    assert max(speeds[:STRUCK_HOLD_TICKS]) == 0.0
    assert speeds[-1] > 0.5


def test_an_ego_survives_off_road_backwards_and_at_the_end_of_the_net(roads: RoadMap) -> None:
    path = [EgoState(x, 30.0, math.pi, 5.0) for x in np.arange(60.0, -60.0, -5.0)]
    path += [EgoState(x, -1.6, 0.0, 20.0) for x in np.arange(-60.0, 160.0, 1.0)]
    path += [EgoState(-60.0, -4.8, 0.0, 0.0)] * 200
    overlaps = 0
    with SumoWorld(scenario(car("late", pos=10.0)), roads, {"e": SIZE}, seed=1) as world:
        around = world.start({"e": path[0]}, Actors.empty())
        for ego in path:
            around = world.advance({"e": ego}, Actors.empty(), ())
        overlaps = overlap(path[-1], around.actors)
    assert not overlaps


def test_frozen_green_and_programs(lit_roads: RoadMap) -> None:
    away = {"e": EgoState(0, 120, 0, 0)}
    with SumoWorld(scenario(), lit_roads, {"e": SIZE}, seed=1) as world:
        states = {frozenset(world.start(away, Actors.empty()).signals.values())}
        states |= {frozenset(world.advance(away, Actors.empty(), ()).signals.values()) for _ in range(1000)}
    assert all(set(state) == {"g"} for group in states for state in group)
    with SumoWorld(scenario(signals="program"), lit_roads, {"e": SIZE}, seed=1) as world:
        shown = [world.advance(away, Actors.empty(), ()).signals["x"] for _ in range(1000)]
    assert any("r" in state for state in shown)
    assert len(set(shown)) > 2


def test_the_same_seed_gives_the_same_traffic(roads: RoadMap) -> None:
    cars = [car(f"v{i}", pos=10.0 + 12 * i, lane=i % 2) for i in range(8)]

    def run(seed: int) -> list[float]:
        with SumoWorld(scenario(*cars), roads, {"e": SIZE}, seed=seed) as world:
            around = world.start({"e": EgoState(-20.0, -4.8, 0.0, 0.0)}, Actors.empty())
            for _ in range(200):
                around = world.advance({"e": EgoState(-20.0, -4.8, 0.0, 0.0)}, Actors.empty(), ())
            return [*around.actors.x, *around.actors.y]

    assert run(3) == run(3)
    assert run(3) != run(4)


def test_a_second_simulation_is_refused_and_a_closed_one_is_forgotten(roads: RoadMap) -> None:
    with (
        SumoWorld(scenario(), roads, {"e": SIZE}, seed=1),
        pytest.raises(WorldError, match="one simulation a process"),
    ):
        SumoWorld(scenario(), roads, {"e": SIZE}, seed=1).__enter__()
    with SumoWorld(scenario(), roads, {"e": SIZE}, seed=1) as world:
        world.start({"e": EgoState(0, 120, 0, 0)}, Actors.empty())


def test_background_on_roads_that_do_not_exist_is_the_files_fault(roads: RoadMap) -> None:
    with pytest.raises(InputError, match="scenario s: SUMO refused it"):
        SumoWorld(scenario(car("bg", edges=("nowhere",))), roads, {"e": SIZE}, seed=1).__enter__()
