"""All families of the hard tier: sound scenarios on a place that each asks for, equal for equal candidates."""

import math
import random
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

import pytest
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import wrap_angle
from mdrive_sumo.generate.hard.families import FAMILIES
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily
from mdrive_sumo.generate.hard.hard_places import HardPlace, PlaceTask, draw_hard_place
from mdrive_sumo.generate.hard.riders import CAV_CLEAR_M
from mdrive_sumo.generate.hard.sites.no_stopping import build_zebras
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import ReplayMotion, StandingMotion
from mdrive_sumo.scenario.start_boxes import CAR, build_user_box

TRIES = 16
"""Candidates of a family on a place of which at least one must be sound, ..."""
SOUND = 3
"""... and so many of these are looked at."""


def draw_candidates(family: ScenarioFamily, place: str) -> Iterator[FamilyCandidate]:
    rng = random.Random(family.category)
    for number in range(TRIES):
        values = tuple(rng.uniform(one.low, one.high) for one in family.parameters)
        yield FamilyCandidate(f"{family.category}_{number}", place, values, f"seed{number}")


def build(family: ScenarioFamily, candidate: FamilyCandidate, roads: RoadMap) -> Scenario | None:
    try:
        return family.build(candidate, roads)
    except (ProposalRejected, InputError):
        return None


@pytest.fixture
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.getbasetemp() / "hard-places"


def draw_place_of(family: ScenarioFamily, folder: Path) -> HardPlace:
    for number, choice in enumerate(family.places):
        if place := draw_hard_place(PlaceTask(choice, f"families/{number}", folder)):
            return place
    raise AssertionError(f"{family.category}: expected a sound place, found none")


@pytest.mark.slow
@pytest.mark.parametrize("category", FAMILIES)
def test_a_family_builds_sound_scenarios_on_its_places(category: str, folder: Path) -> None:
    family = FAMILIES[category]
    place = draw_place_of(family, folder)
    roads = place.load_roads()
    drawn = ((one, build(family, one, roads)) for one in draw_candidates(family, place.name))
    built = list(islice(((one, made) for one, made in drawn if made is not None), SOUND))
    assert built, f"expected a sound one of {TRIES} candidates on {place.name}, found none"
    candidate, scenario = built[0]
    assert (scenario.category, scenario.network, scenario.speeds) == (category, place.name, "road")
    assert 2 <= len(scenario.egos) <= 12
    assert family.build(candidate, roads) == scenario
    assert all(len({one.id for one in made.actors}) == len(made.actors) for _, made in built)
    for _, made in built:
        check_that_it_could_stand_in_a_city(made, roads)


def check_that_it_could_stand_in_a_city(scenario: Scenario, roads: RoadMap) -> None:
    """Nobody rides through anything, nothing stands on a zebra, and what parks leaves CAVs and other streets room."""
    standing = [one for one in scenario.actors if isinstance(one.motion, StandingMotion)]
    riders = [one for one in scenario.actors if one.stream]
    assert riders
    things = shapely.union_all([*map(build_user_box, standing), *roads.building_shapes])
    for rider in riders:
        assert isinstance(rider.motion, ReplayMotion)
        course = shapely.LineString([pose[1:3] for pose in rider.motion.poses])
        assert course.distance(things) > rider.width / 2
    routes = shapely.MultiLineString([ego.xy for ego in scenario.egos])
    zebras = build_zebras(roads)
    for actor in standing:
        box = build_user_box(actor)
        assert not box.intersects(zebras)
        if actor.id.startswith(("parked", "standing")):
            assert box.distance(routes) >= CAR.width / 2 + CAV_CLEAR_M - 0.01
        if actor.id.startswith("parked") or scenario.category == "parked-rows":
            assert not box.intersects(build_carriageway_across(roads, actor.start.yaw))


def build_carriageway_across(roads: RoadMap, yaw: float) -> BaseGeometry:
    """Return the carriageways [m] in junctions of all streets that cross that direction [rad]."""
    across = [one for one in roads.lanes.values() if one.junction and is_straight(one) and is_across(one, yaw)]
    return shapely.union_all([shapely.LineString(one.centre.xy).buffer(one.width / 2 - 0.1) for one in across])


def is_straight(lane: Lane) -> bool:
    return abs(wrap_angle(lane.centre.yaw_at(lane.centre.length) - lane.centre.yaw_at(0.0))) < 0.1


def is_across(lane: Lane, yaw: float) -> bool:
    return abs(math.sin(lane.centre.yaw_at(0.0) - yaw)) > 0.7
