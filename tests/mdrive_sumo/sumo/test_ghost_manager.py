"""SUMO's traffic reacts to scripted actors and to everything else that has only ghosts."""

from dataclasses import replace

import numpy as np
import pytest
from testing.sumo_crossing import SIZE, car, compiled, scenario

from mdrive_sumo.core.geometry import boxes_corners, boxes_overlap
from mdrive_sumo.core.state import Actors, EgoState, Kind
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, KindName
from mdrive_sumo.sumo import SumoWorld
from mdrive_sumo.sumo.ghost_placement import SourceBox, find_ghosts

AWAY = {"e": EgoState(60, 60, 0, 0)}
ONE_LANE = ("c", "d")
"""Northbound, x = -1.6: no vehicle can pass on another lane."""


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    return compiled(tmp_path_factory.mktemp("cross"), "priority")


def thing(x: float, y: float, size: tuple[float, float], speed: float = 0.0, kind: Kind = Kind.STATIC) -> Actors:
    columns = (np.array([value]) for value in (x, y, np.pi / 2, speed, *size))
    return Actors(("thing",), np.array([kind], dtype=np.uint8), *columns)


def driven(roads: RoadMap, seen: list[Actors], actors: tuple[Actor, ...] = ()) -> tuple[Actors, int]:
    """The background vehicle at the end, and in how many ticks it overlapped the scripted actor."""
    overlaps = 0
    with SumoWorld(scenario(car("bg", edges=ONE_LANE), actors=actors), roads, {"e": SIZE}, seed=1) as world:
        around = world.start(AWAY, seen[0])
        for scripted in seen[1:]:
            around = world.advance(AWAY, scripted, ())
            assert set(around.actors.ids) <= {"bg"}
            both = (around.actors, scripted)
            if all(len(one) for one in both):
                a, b = (boxes_corners(one.x, one.y, one.yaw, one.length, one.width) for one in both)
                overlaps += bool(boxes_overlap(a, b).any())
    return around.actors, overlaps


def lane_x(roads: RoadMap) -> float:
    return float(roads.lanes["c_0"].centre.xy[0, 0])


@pytest.mark.slow
@pytest.mark.parametrize(
    ("size", "kind"), [((4.6, 1.85), Kind.VEHICLE), ((0.5, 0.5), Kind.PEDESTRIAN), ((0.4, 0.4), Kind.STATIC)]
)
def test_a_follower_stops_behind_a_parked_car_a_person_or_a_cone_on_its_lane(
    roads: RoadMap, size: tuple[float, float], kind: Kind
) -> None:
    around, overlaps = driven(roads, [thing(lane_x(roads), -80.0, size, kind=kind)] * 400)
    assert overlaps == 0
    assert around.speed[0] < 0.1
    assert -80.0 - 6.0 < around.y[0] + 2.5 < -80.0 - size[0] / 2


def test_a_follower_passes_a_cone_three_metres_beside_the_lane(roads: RoadMap) -> None:
    around, _ = driven(roads, [thing(lane_x(roads) + 3.0, -80.0, (0.4, 0.4))] * 200)
    assert around.y[0] > -60.0


def test_what_a_scenario_does_not_mirror_is_driven_through(roads: RoadMap) -> None:
    kind: KindName = "vehicle"
    actor = Actor(id="thing", kind=kind, length=4.6, width=1.85, start=Pose(x=0, y=0, yaw=0), mirrored=False)
    around, overlaps = driven(roads, [thing(lane_x(roads), -80.0, (4.6, 1.85))] * 200, (actor,))
    assert around.y[0] > -60.0
    assert overlaps > 0


def test_a_follower_goes_on_when_the_thing_has_gone(roads: RoadMap) -> None:
    there = [thing(lane_x(roads), -80.0, (0.5, 0.5))] * 200
    around, overlaps = driven(roads, [*there, *[Actors.empty()] * 200])
    assert overlaps == 0
    assert around.y[0] > -60.0


def test_a_follower_keeps_behind_a_cyclist_ahead(roads: RoadMap) -> None:
    path = [thing(lane_x(roads), -110.0 + 0.2 * i, (1.8, 0.6), 4.0, Kind.CYCLIST) for i in range(300)]
    around, overlaps = driven(roads, path)
    assert overlaps == 0
    assert around.speed[0] == pytest.approx(4.0, abs=0.7)


@pytest.mark.slow
def test_traffic_waits_for_a_pedestrian_that_stops_on_the_lane(roads: RoadMap) -> None:
    x = lane_x(roads)
    path = [thing(x + max(6.0 - 0.07 * i, 0.0), -40.0, (0.5, 0.5), 1.4 * (i < 86), Kind.PEDESTRIAN) for i in range(400)]
    around, overlaps = driven(roads, path)
    assert overlaps == 0
    assert around.y[0] < -40.0


def test_nothing_is_placed_where_there_is_no_traffic_to_see_it(roads: RoadMap, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object) -> None:
        raise AssertionError("a ghost was placed")

    monkeypatch.setattr("mdrive_sumo.sumo.ghost_manager.add_placed_vehicle", refused)
    with SumoWorld(scenario(), roads, {"e": SIZE}, seed=1) as world:
        world.start(AWAY, thing(lane_x(roads), -80.0, (4.6, 1.85)))
        for _ in range(10):
            world.advance(AWAY, thing(lane_x(roads), -80.0, (4.6, 1.85)), ())


def test_a_thing_that_stands_is_placed_once(roads: RoadMap, monkeypatch: pytest.MonkeyPatch) -> None:
    from mdrive_sumo.sumo import ghost_manager

    placed: list[str] = []
    real = ghost_manager.place_vehicle

    def counted(name: str, *rest: object) -> None:
        placed.append(name)
        real(name, *rest)

    monkeypatch.setattr(ghost_manager, "place_vehicle", counted)
    driven(roads, [thing(lane_x(roads), -80.0, (4.6, 1.85))] * 100)
    assert placed == ["ghost:scripted:thing:c_0"]


def test_ghosts_cover_what_a_box_has_of_each_corridor(roads: RoadMap) -> None:
    across = SourceBox("b", -60.0, -3.2, np.pi / 2, 0.0, 4.9, 2.0)
    found = find_ghosts([across], roads)
    assert sorted(found) == ["ghost:b:a_0", "ghost:b:a_1"]
    for ghost in found.values():
        assert ghost.length == pytest.approx(2.0)
        assert ghost.lane.centre.at(ghost.front_s)[0] == pytest.approx(-59.0)
    assert sorted(find_ghosts([SourceBox("b", -60.0, -3.2, np.pi / 2, 0.0, 4.9, 2.0, "a_0")], roads)) == ["ghost:b:a_1"]
    assert find_ghosts([], roads) == {}


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("gap_m", "is_seen"), [(-0.05, True), (0.05, False)])
def test_a_lane_has_a_ghost_for_what_its_vehicles_would_touch_and_none_for_what_they_pass(
    gap_m: float, is_seen: bool, side: float, roads: RoadMap
) -> None:
    """`gap_m`: between a box beside the lane and a background vehicle of the usual size in the middle of it."""
    width = 0.4
    x = lane_x(roads) + side * (car("bg").width / 2 + gap_m + width / 2)
    found = find_ghosts([SourceBox("b", x, -80.0, np.pi / 2, 0.0, 0.4, width)], roads)
    assert sorted(found) == (["ghost:b:c_0"] if is_seen else [])


def test_a_cycle_lane_has_ghosts_only_beside_a_lane_for_cars(roads: RoadMap) -> None:
    lane = replace(roads.lanes["c_0"], id="cycles")
    (x, y), yaw = lane.centre.at(20.0), lane.centre.yaw_at(20.0)
    box = SourceBox("e", x, y, yaw, 0.0, 4.6, 1.85, visible_lane="c_0")
    for edge, lanes in (("c", ["cycles"]), ("a path of its own", list[str]())):
        network = replace(roads, cycle_lanes={"cycles": replace(lane, edge=edge)})
        assert [ghost.lane.id for ghost in find_ghosts([box], network).values()] == lanes
