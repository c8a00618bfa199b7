"""Which episodes start first."""

from pathlib import Path

import pytest

from mdrive_sumo.runs.episode_cost import estimate_cost
from mdrive_sumo.scenario.reference_times import find_reference_times, save_reference_times
from mdrive_sumo.scenario.suite import Suite, load_suite, save_suite
from mdrive_sumo.scoring.criteria import compute_time_limit_ticks


@pytest.fixture(scope="module")
def interdrive() -> Suite:
    return load_suite("interdrive@0")


def test_an_episode_costs_its_ticks_times_its_road_users(interdrive: Suite) -> None:
    scenario = interdrive.scenarios[0]
    expected = max(find_reference_times(scenario, interdrive.folder).values()) * len(scenario.egos)
    assert estimate_cost(scenario, interdrive.folder) == expected
    assert estimate_cost(scenario, interdrive.folder, ticks=7) == 7 * len(scenario.egos)
    one_more = scenario.model_copy(update={"egos": (*scenario.egos, scenario.egos[0])})
    assert estimate_cost(one_more, interdrive.folder, ticks=7) == 7 * len(scenario.egos) + 7


def test_reference_times_of_another_state_are_better_than_none(interdrive: Suite, tmp_path: Path) -> None:
    scenario = interdrive.scenarios[0].model_copy(update={"description": "another"})
    suite = Suite(interdrive.about.model_copy(update={"checksum": ""}), tmp_path, (scenario,))
    save_suite(suite)
    limit = max(compute_time_limit_ticks(scenario).values())
    assert estimate_cost(scenario, tmp_path) == round(limit / 4) * len(scenario.egos)
    save_reference_times(suite, {scenario.id: {scenario.egos[0].id: 123}})
    assert estimate_cost(scenario, tmp_path) == 123 * len(scenario.egos)
    changed = scenario.model_copy(update={"description": "a third"})
    assert not find_reference_times(changed, tmp_path)
    assert estimate_cost(changed, tmp_path) == 123 * len(scenario.egos)
