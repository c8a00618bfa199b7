"""All families of the hard tier: sound scenarios on a place that each asks for, equal for equal candidates."""

import random
from collections.abc import Iterator
from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.hard.families import FAMILIES
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily
from mdrive_sumo.generate.hard.hard_places import HardPlace, PlaceTask, draw_hard_place
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario

TRIES = 16
"""Candidates of a family on a place of which at least one must be sound."""


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


@pytest.mark.parametrize("category", FAMILIES)
def test_a_family_builds_sound_scenarios_on_its_places(category: str, folder: Path) -> None:
    family = FAMILIES[category]
    place = draw_place_of(family, folder)
    roads = place.load_roads()
    built = [(one, made) for one in draw_candidates(family, place.name) if (made := build(family, one, roads))]
    assert built, f"expected a sound one of {TRIES} candidates on {place.name}, found none"
    candidate, scenario = built[0]
    assert (scenario.category, scenario.network, scenario.speeds) == (category, place.name, "road")
    assert 2 <= len(scenario.egos) <= 12
    assert family.build(candidate, roads) == scenario
    assert all(len({one.id for one in made.actors}) == len(made.actors) for _, made in built)
