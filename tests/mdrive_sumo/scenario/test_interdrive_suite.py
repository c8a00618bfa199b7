"""The built-in suite: reproducible, of the paper's size, and every scenario a real conflict that can be solved."""

import shutil
from collections import Counter
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate import validation
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.scenario.packaged_suites import find_suite_folder
from mdrive_sumo.scenario.reference_times import REFERENCE_TIMES_FILE
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.statistics import compute_suite_statistics
from mdrive_sumo.scenario.suite import SCENARIO_FILE, Suite, SuiteFile, load_suite, save_suite
from mdrive_sumo.study.occlusion_certificate import CERTIFICATE_FILE
from mdrive_sumo.worlds.authoring.route_steps import build_route, parse_steps
from tools.build_interdrive_suite import RECIPE_FILE, write_suite

MEASURED_FILES = (CERTIFICATE_FILE, REFERENCE_TIMES_FILE)

COMPOSITION = {
    "ins_c": 6, "ins_ss": 4, "ins_sl": 6, "ins_sr": 6, "ins_oppo": 4,
    "ins_rl": 4, "ins_crosschange": 4, "ins_chaos": 4, "hw_merge": 4, "hw_c": 4,
}  # fmt: skip
"""How many scenarios of each category the original has."""


@pytest.fixture(scope="module")
def suite() -> Suite:
    return load_suite("interdrive@0")


@pytest.fixture(scope="module")
def street() -> RoadMap:
    return load_road_map(find_network_folder("main_street"))


@pytest.mark.slow
def test_the_recipe_makes_the_packaged_files(suite: Suite, tmp_path: Path) -> None:
    shutil.copy(find_suite_folder("interdrive@0") / RECIPE_FILE, tmp_path)
    write_suite(tmp_path)
    made = {path.relative_to(tmp_path): path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}
    files = (path for path in suite.folder.rglob("*") if path.is_file() and path.name not in MEASURED_FILES)
    kept = {path.relative_to(suite.folder): path.read_bytes() for path in files}
    assert sorted(made) == sorted(kept)
    assert [str(name) for name in made if made[name] != kept[name]] == []


def test_composition_is_that_of_the_original(suite: Suite) -> None:
    assert Counter(scenario.category for scenario in suite.scenarios) == COMPOSITION
    assert all(2 <= len(scenario.egos) <= 8 for scenario in suite.scenarios)


def test_sizes_are_those_of_the_paper(suite: Suite) -> None:
    found = compute_suite_statistics(suite.scenarios)
    assert (found.scenarios, found.cavs) == (46, 175)
    assert found.mean_cavs == pytest.approx(3.80, rel=0.05)
    assert found.mean_route_m == pytest.approx(51.83, rel=0.05)
    assert found.mean_heading_change_deg == pytest.approx(65.85, rel=0.05)
    assert found.mean_actors == 0


def test_routes_bend_no_tighter_than_a_car_does(suite: Suite) -> None:
    """No kink anywhere: over 3 m a route turns by less than a circle of 4.5 m radius (centre lines are polygons)."""
    for scenario in suite.scenarios:
        for ego in scenario.egos:
            hops = np.diff(ego.xy[:-1], axis=0)
            yaw = np.unwrap(np.arctan2(hops[:, 1], hops[:, 0]))
            assert np.abs(yaw[3:] - yaw[:-3]).max() < 3 / 4.5, (scenario.id, ego.id)


@pytest.mark.parametrize("text", ["", "west_in_1 5", "west_in_1 > east_out_1 5", "west_in_1 x > east_out_1 5"])
def test_a_bad_line_of_the_recipe_is_named(text: str) -> None:
    with pytest.raises(InputError, match=r"route: expected"):
        parse_steps(text)


def test_an_unknown_lane_is_named(street: RoadMap) -> None:
    with pytest.raises(InputError, match="found 'nowhere_1'"):
        build_route(street, "west_in_1 -20 > nowhere_1 5")


def test_a_lane_change_begins_where_the_recipe_says(street: RoadMap) -> None:
    route = build_route(street, "west_in_2 -45 > west_in_1 -40 > east_out_1 10")
    left = street.lanes["west_in_2"].centre
    apart = [abs(left.project(x, y)[1]) for x, y in route.xy[:25]]
    assert max(apart[:5]) < 0.05
    assert apart[-1] == pytest.approx(3.5, abs=0.1)


def examined(suite: Suite, scenario: str) -> validation.ScenarioValidation:
    return validation.validate_scenario(validation.ValidationTask(suite.folder, scenario))


@pytest.mark.slow
def test_a_conflict_is_found_difficult_solvable_and_hidden(suite: Suite) -> None:
    found = examined(suite, "i07_ins_ss_town")
    assert found.problems == ()
    assert found.blind_ttc_s is not None
    assert found.blind_ttc_s < 0.9
    assert found.omniscient_ds == 100.0
    assert found.is_occluded


def changed(suite: Suite, folder: Path, **update: object) -> Suite:
    """The suite with its first scenario changed, on disk."""
    first = suite.scenarios[0].model_copy(update=update)
    made = Suite(SuiteFile(name="changed", title=""), folder, (Scenario.model_validate(first.model_dump()),))
    save_suite(made)
    return made


@pytest.mark.slow
def test_a_harmless_scenario_fails(suite: Suite, tmp_path: Path) -> None:
    alone = changed(suite, tmp_path, egos=suite.scenarios[0].egos[:1])
    (problem,) = examined(alone, alone.scenarios[0].id).problems
    assert problem == "not difficult: expected a blind TTC below 0.9 s, found none"


def test_cavs_inside_each_other_fail(suite: Suite, tmp_path: Path) -> None:
    one, other = suite.scenarios[0].egos
    egos = (
        one,
        one.model_copy(update={"id": other.id, "start": Pose(x=one.start.x + 1, y=one.start.y, yaw=0.0)}),
    )
    stacked = changed(suite, tmp_path, egos=egos)
    assert examined(stacked, stacked.scenarios[0].id).problems == (
        "CAV 0 and CAV 1 start inside each other (6.55 m2 overlap)",
    )


def test_a_suite_of_another_size_fails(suite: Suite) -> None:
    short = replace(suite, scenarios=suite.scenarios[:6])
    plain = [validation.ScenarioValidation(scenario.id, ()) for scenario in short.scenarios]
    problems = " ".join(validation.find_suite_problems(short, plain))
    assert "interdrive: CAVs: expected 3.8 +- 0.19 on average, found" in problems
    assert "interdrive: expected 46 scenarios, found 6" in problems
    assert "interdrive: expected 15 conflicts or more that are hidden until late, found 0" in problems


def test_a_sample_is_always_the_same(suite: Suite) -> None:
    drawn = validation.sample_scenarios(suite, 6)
    assert len(drawn) == 6
    assert drawn == validation.sample_scenarios(suite, 6)
    assert validation.sample_scenarios(suite, None) == suite.scenarios


@pytest.mark.full
def test_every_scenario_is_difficult_and_solvable(suite: Suite) -> None:
    found = tuple(validation.validate_scenarios(suite, suite.scenarios, workers=2))
    assert [(one.scenario, one.problems) for one in found if one.problems] == []
    assert validation.find_suite_problems(suite, found) == ()
    assert sorted(one.scenario for one in found) == sorted(
        path.parent.name for path in suite.folder.glob(f"*/{SCENARIO_FILE}")
    )
