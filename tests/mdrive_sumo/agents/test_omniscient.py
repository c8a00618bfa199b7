"""`omniscient` with obstacles on its path and pedestrians who may step out."""

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from testing.agents_driving import Box, all_arrived, drive

from mdrive_sumo.agents.omniscient import OmniscientAgent
from mdrive_sumo.contract import Briefing, Objects, Observation, OwnState, Privileged
from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.core.state import Kind
from mdrive_sumo.generate.built_in_drive import drive_episode
from mdrive_sumo.planning.joint_plan import has_undecided_vehicle, plan_joint_detours
from mdrive_sumo.planning.parameters import PEDESTRIAN
from mdrive_sumo.planning.pedestrian_caution import limit_speeds_near_pedestrians, predict_walking_on
from mdrive_sumo.planning.reference_path import SPACING_M, build_path
from mdrive_sumo.planning.reference_path import ReferencePath as Way
from mdrive_sumo.roads import Lane, RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import ScoreMode, score_episode
from mdrive_sumo.vehicle.dynamics import MKZ_2017, to_vehicle_facts

CAR = to_vehicle_facts(MKZ_2017)
EAST = np.column_stack((np.arange(0.0, 101.0), np.zeros(101)))
WEST = np.column_stack((np.arange(100.0, -1.0, -1.0), np.full(101, 3.5)))


def two_lanes() -> RoadMap:
    """A straight road of one lane each way."""

    def lane(name: str, xy: Float) -> Lane:
        return Lane(name, name, 0, 3.5, 13.89, Polyline(xy), False, (), "", "", {})

    lanes = {"r_0": lane("r_0", EAST), "l_0": lane("l_0", WEST)}
    return RoadMap("two lanes", Path("/nowhere"), lanes, (), (), (), (), (), "none")


def things(*rows: tuple[float, float, float, float], kind: Kind = Kind.STATIC) -> Objects:
    """Cubes of 1 m at x, y [m], yaw [rad], with a speed [m/s]."""
    x, y, yaw, speed = np.array(rows).T
    ones = np.ones(len(x))
    return Objects(
        tuple(f"b{i}" for i in range(len(x))), np.full(len(x), kind, dtype=np.uint8), x, y, yaw, speed, ones, ones
    )


def known(objects: Objects) -> Privileged:
    """Two CAVs that come towards each other on two lanes, and what else there is."""
    states = (OwnState(0.0, 0.0, 0.0, 0, 0, 0, 0), OwnState(100.0, 3.5, math.pi, 0, 0, 0, 0))
    room = np.tile((5.25, 1.75), (101, 1))
    return Privileged(("0", "1"), states, (EAST, WEST), (None, None), objects, (room, room))


def told(ego: str) -> Briefing:
    route = {"0": EAST, "1": WEST}[ego]
    yaw, s = np.full(101, 0.0 if ego == "0" else math.pi), np.arange(101.0)
    return Briefing(ego, 0, 0.05, 100.0, CAR, route, yaw, s, np.full(101, 3.5), np.full(101, 13.0))


@pytest.mark.slow
def test_omniscient_passes_a_parked_car() -> None:
    episode = drive("omniscient", {"0": EAST}, [Box(45.0, -0.9, 0.0)], two_lanes())
    assert all_arrived(episode)
    assert not episode.contacts


@pytest.mark.slow
def test_omniscient_passes_a_parked_car_with_oncoming_cavs() -> None:
    episode = drive("omniscient", {"0": EAST, "1": WEST}, [Box(45.0, -0.9, 0.0)], two_lanes())
    assert all_arrived(episode)
    assert not episode.contacts


@pytest.mark.parametrize(("first_tick", "stride"), [(0, 1), (0, 4), (7, 3)])
@pytest.mark.parametrize("parked", [False, True])
def test_it_plans_also_if_observed_every_few_ticks_only(first_tick: int, stride: int, parked: bool) -> None:
    """As in open loop. A parked car delays the first plan by `decision_ticks`; the second CAV's by one tick more."""
    seen = known(things((40.0, -0.5 if parked else -4.0, 0.0, 0.0), kind=Kind.VEHICLE))
    for ego, own in zip(("0", "1"), seen.states, strict=True):
        agent = OmniscientAgent({})
        agent.start(told(ego))
        ticks = range(first_tick, first_tick + 30, stride)
        *_, last = (agent.act(Observation(tick, own, privileged=seen)) for tick in ticks)
        assert last.plan is not None
        assert len(last.plan.points) > 1, "it drives"


def test_all_cavs_find_the_same_detours() -> None:
    seen = known(things((40.0, -0.5, 0.0, 0.0), (60.0, 4.0, 0.0, 0.0)))
    mine, theirs = plan_joint_detours(seen, told("0")), plan_joint_detours(seen, told("1"))
    for ego in ("0", "1"):
        assert np.array_equal(mine[ego].xy, theirs[ego].xy)
        assert np.abs(mine[ego].xy[:, 1] - (0.0, 3.5)[int(ego)]).max() > 0.5


def test_every_obstacle_on_a_long_path_is_passed() -> None:
    seen = known(things((25.0, -0.5, 0.0, 0.0), (75.0, -0.5, 0.0, 0.0)))
    path = plan_joint_detours(seen, told("0"))["0"]
    aside = np.interp((25.0, 50.0, 75.0), path.xy[:, 0], path.xy[:, 1])
    assert aside == pytest.approx((1.5, 0.0, 1.5), abs=0.05)


def test_without_obstacles_the_path_is_unchanged() -> None:
    seen = known(things((40.0, -4.0, 0.0, 0.0), (60.0, 0.0, 0.0, 3.0)))
    assert np.array_equal(plan_joint_detours(seen, told("0"))["0"].xy, build_path(EAST, CAR.rear_to_centre, 0.0).xy)


@pytest.mark.parametrize(
    ("row", "kind", "expected"),
    [
        ((40.0, 0.0, 0.0, 0.0), Kind.VEHICLE, True),
        ((40.0, 0.0, 0.0, 2.0), Kind.VEHICLE, False),
        ((40.0, 0.0, 0.0, 0.0), Kind.STATIC, False),
        ((40.0, -4.0, 0.0, 0.0), Kind.VEHICLE, False),
    ],
)
def test_only_a_vehicle_that_stands_on_a_path_may_be_about_to_leave(
    row: tuple[float, float, float, float], kind: Kind, expected: bool
) -> None:
    assert has_undecided_vehicle(known(things(row, kind=kind)), told("0")) is expected


def straight() -> tuple[Way, Float]:
    path = build_path(EAST, CAR.rear_to_centre, 0.0)
    return path, np.full(len(path.xy), 9.0)


def test_speed_is_reduced_before_a_pedestrian_who_faces_the_road() -> None:
    path, speeds = straight()
    slow = limit_speeds_near_pedestrians(
        path, speeds, things((50.0, -5.0, math.pi / 2, 0.0), kind=Kind.PEDESTRIAN), CAR
    )
    stations = np.arange(len(slow)) * SPACING_M
    assert slow[(stations > 46) & (stations < 52)] == pytest.approx(PEDESTRIAN.creeping_speed)
    assert (slow[stations < 10] == 9.0).all()
    assert (slow[stations > 60] == 9.0).all()
    stop_m = slow**2 / (2 * 2.0)
    before = stations < 40
    assert (stations + stop_m)[before].max() < 50.0 - 0.5 - CAR.length / 2


@pytest.mark.parametrize(
    ("row", "kind"),
    [
        ((50.0, -5.0, -math.pi / 2, 0.0), Kind.PEDESTRIAN),
        ((50.0, -5.0, 0.0, 0.0), Kind.PEDESTRIAN),
        ((50.0, -5.0, math.pi / 2, 1.5), Kind.PEDESTRIAN),
        ((50.0, -5.0, math.pi / 2, 0.0), Kind.STATIC),
    ],
)
def test_other_road_users_do_not_reduce_the_speed(row: tuple[float, float, float, float], kind: Kind) -> None:
    path, speeds = straight()
    assert np.array_equal(limit_speeds_near_pedestrians(path, speeds, things(row, kind=kind), CAR), speeds)


def test_a_waiting_pedestrian_who_has_started_walks_on() -> None:
    people = things((5.0, 0.0, 0.0, 0.0), (9.0, 0.0, 0.0, 0.0), (12.0, 0.0, 0.0, 0.8), kind=Kind.PEDESTRIAN)
    first = {"b0": (5.0, 0.0), "b1": (8.0, 0.0), "b2": (8.0, 0.0)}
    assert predict_walking_on(people, first).speed.tolist() == [0.0, PEDESTRIAN.walking_speed, 0.8]
    cars = replace(people, kind=np.full(3, Kind.VEHICLE, dtype=np.uint8))
    assert predict_walking_on(cars, first).speed.tolist() == [0.0, 0.0, 0.8]


@pytest.mark.slow
def test_it_stops_at_red_with_the_speeds_of_the_protocol_too() -> None:
    (written,) = load_suite("interdrive@0").select("i22_ins_sr_boulevard")
    scenario, roads = written.model_copy(update={"signals": "program"}), load_road_map(find_network_folder("boulevard"))
    found = score_episode(drive_episode(scenario, roads, "omniscient"), scenario, roads, ScoreMode.MDRIVE, 0)
    assert "red-light" not in {one.kind for ego in found.egos for one in ego.infractions}
    blind = score_episode(drive_episode(scenario, roads, "constant-speed"), scenario, roads, ScoreMode.MDRIVE, 0)
    assert "red-light" in {one.kind for ego in blind.egos for one in ego.infractions}
