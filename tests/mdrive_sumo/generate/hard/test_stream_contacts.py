"""Streams touch nothing on their way: what stands, buildings, and those of other streams at the same time."""

import pytest

from mdrive_sumo.generate.drawn_places import PlaceChoice
from mdrive_sumo.generate.hard.hard_places import PlaceTask, draw_hard_place
from mdrive_sumo.generate.hard.stream_contacts import LEAST_M, find_stream_contacts
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion
from mdrive_sumo.worlds.placement.bodies import BODIES, build_actor, build_parked_vehicle

FAR_M = 2000.0
"""[m] Off the place, where nothing else stands."""


@pytest.fixture(scope="module")
def roads(tmp_path_factory: pytest.TempPathFactory) -> RoadMap:
    choice = PlaceChoice("crossing", {"area": "town", "arms": 4, "control": "priority"})
    place = draw_hard_place(PlaceTask(choice, "streams", tmp_path_factory.getbasetemp() / "hard-places"))
    assert place is not None
    return place.load_roads()


def make_rider(name: str, begin_s: float, begin: tuple[float, float], end: tuple[float, float]) -> Actor:
    """Return a bicycle that rides along x or y at 6 m/s."""
    yaw = 0.0 if begin[1] == end[1] else 1.5708
    end_s = begin_s + (abs(end[0] - begin[0]) + abs(end[1] - begin[1])) / 6.0
    poses = ((begin_s, *begin, yaw), (end_s, *end, yaw))
    start = Pose(x=begin[0], y=begin[1], yaw=yaw)
    return build_actor(name, BODIES["bicycle"], start, motion=ReplayMotion(poses=poses), avoid_collision=False)


def list_contacts(roads: RoadMap, *actors: Actor) -> list[str]:
    return list(find_stream_contacts(Scenario.model_construct(actors=actors), roads))


EAST = make_rider("east0", 0.0, (FAR_M, 0.0), (FAR_M + 60.0, 0.0))


@pytest.mark.parametrize(("aside_m", "is_met"), [(0.0, True), (1.35, True), (1.45, False), (-1.35, True)])
def test_the_whole_way_is_swept_for_what_stands(roads: RoadMap, aside_m: float, is_met: bool) -> None:
    """A van of 2 m and a bicycle of 0.6 m are 1.3 m apart when they touch."""
    parked = build_parked_vehicle("parked0", "van", Pose(x=FAR_M + 50.0, y=aside_m, yaw=0.0))
    expected = f"expected east0 to keep {LEAST_M:g} m from everything on its way, found parked0 there"
    assert list_contacts(roads, EAST, parked) == [expected] * is_met


def test_buildings_and_trees_are_met(roads: RoadMap) -> None:
    one = roads.buildings[0]
    x, y = one.outline.mean(axis=0).tolist()
    rider = make_rider("east0", 0.0, (x - 200.0, y), (x, y))
    assert "found " in list_contacts(roads, rider)[0]


@pytest.mark.parametrize(
    ("later_s", "is_met"), [(0.0, True), (0.3, True), (0.45, False), (-0.45, False), (20.0, False)]
)
def test_streams_may_cross_one_after_the_other(roads: RoadMap, later_s: float, is_met: bool) -> None:
    """Bicycles of 1.8 m x 0.6 m touch at right angles if they come within 2.4 m, which is 0.4 s at 6 m/s."""
    north = make_rider("north0", 5.0 + later_s, (FAR_M + 60.0 - 30.0, -30.0), (FAR_M + 30.0, 30.0))
    east = make_rider("east0", 5.0, (FAR_M, 0.0), (FAR_M + 60.0, 0.0))
    found = list_contacts(roads, east, north)
    assert [text.startswith(f"expected east0 to keep {LEAST_M:g} m from north0") for text in found] == [True] * is_met


def test_members_of_a_stream_are_not_compared_and_others_are_none(roads: RoadMap) -> None:
    second = make_rider("east1", 0.2, (FAR_M, 0.0), (FAR_M + 60.0, 0.0))
    assert list_contacts(roads, EAST, second) == []
    parked = build_parked_vehicle("parked0", "van", Pose(x=FAR_M, y=0.0, yaw=0.0))
    assert list_contacts(roads, parked) == []
