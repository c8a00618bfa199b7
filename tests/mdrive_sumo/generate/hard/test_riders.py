"""Families of riders: every CAV crosses a stream that passes closely behind what stands at the kerb."""

import random
from pathlib import Path

import pytest
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.hard.family import FamilyCandidate, ScenarioFamily
from mdrive_sumo.generate.hard.hard_places import PlaceTask, draw_hard_place
from mdrive_sumo.generate.hard.riders import FAMILIES
from mdrive_sumo.generate.rejection import ProposalRejected
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion
from mdrive_sumo.scenario.start_boxes import build_user_box

TRIES = 8


def build_one(family: ScenarioFamily, folder: Path) -> tuple[dict[str, float], Scenario]:
    place = draw_hard_place(PlaceTask(family.places[0], "families/0", folder))
    assert place is not None
    roads, rng = place.load_roads(), random.Random(family.category)
    for number in range(TRIES):
        values = tuple(rng.uniform(one.low, one.high) for one in family.parameters)
        try:
            made = family.build(FamilyCandidate(f"one_{number}", place.name, values, "seed"), roads)
        except (ProposalRejected, InputError):
            continue
        return dict(zip((one.name for one in family.parameters), values, strict=True)), made
    raise AssertionError(f"{family.category}: expected a sound candidate on {place.name}, found none")


def build_course(rider: Actor) -> shapely.LineString:
    assert isinstance(rider.motion, ReplayMotion)
    return shapely.LineString([pose[1:3] for pose in rider.motion.poses])


@pytest.mark.parametrize("family", FAMILIES, ids=lambda family: family.category)
def test_every_cav_crosses_riders_who_pass_closely_behind_a_row(
    family: ScenarioFamily, tmp_path_factory: pytest.TempPathFactory
) -> None:
    values, scenario = build_one(family, tmp_path_factory.getbasetemp() / "hard-places")
    riders = [one for one in scenario.actors if one.kind == "cyclist"]
    parked = [build_user_box(one) for one in scenario.actors if one.kind == "vehicle"]
    courses = [build_course(one) for one in riders]
    assert not any(one.avoid_collision for one in riders)
    for ego in scenario.egos:
        route = shapely.LineString([point[:2] for point in ego.route])
        assert any(route.crosses(course) for course in courses)
        assert min(box.distance(route) for box in parked) >= values["side_m"] - 0.2
    gaps = [min(box.distance(course) for box in parked) - riders[0].width / 2 for course in courses]
    assert min(gaps) == pytest.approx(values["free_m"], abs=0.16)
    assert max(gaps) < 1.5
