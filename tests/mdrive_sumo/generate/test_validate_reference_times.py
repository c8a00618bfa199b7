"""A suite as a whole: its reference times must belong to its scenarios and still be true."""

from dataclasses import replace
from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.validation import ScenarioValidation, find_suite_problems
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.reference_times import describe_stored_times, save_reference_times
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite
from mdrive_sumo.scoring import ScoreMode


@pytest.fixture
def small(tmp_path: Path) -> Suite:
    save_suite(Suite(SuiteFile(name="small", title="Two of ours"), tmp_path, load_suite("interdrive@0").scenarios[:2]))
    return load_suite(str(tmp_path))


def measure(suite: Suite, ticks: int = 50) -> None:
    save_reference_times(suite, {s.id: {ego.id: ticks for ego in s.egos} for s in suite.scenarios})


def test_reference_times_of_another_state_of_a_scenario_are_told(small: Suite) -> None:
    measure(small)
    assert find_suite_problems(small, ()) == ()
    changed = small.scenarios[0].model_copy(update={"weather": "rain"})
    save_suite(replace(small, scenarios=(changed, small.scenarios[1])))
    (problem,) = find_suite_problems(load_suite(str(small.folder)), ())
    found = "those of another version of the scenario"
    expected = f"{changed.id}: expected times of the scenario as it is, found {found}"
    assert problem.startswith(f"small: reference_times.json: {expected}")
    config = RunConfig(suite=str(small.folder), chosen_mode=ScoreMode.HARD)
    with pytest.raises(InputError, match=f"mode hard: expected times of omniscient .*, found {found}; "):
        prepare(config)


def test_reference_times_that_are_no_longer_found_are_told_and_missing_arrivals_are_not(small: Suite) -> None:
    measure(small)
    first = small.scenarios[0]
    same, other = ({ego.id: ticks for ego in first.egos} for ticks in (50, 51))
    assert find_suite_problems(small, (ScenarioValidation(first.id, (), reference=same),)) == ()
    (problem,) = find_suite_problems(small, (ScenarioValidation(first.id, (), reference=other),))
    assert f"expected what was just found, found otherwise for {first.id}" in problem
    save_reference_times(small, {first.id: {}})
    assert find_suite_problems(small, ()) == ()
    assert describe_stored_times(first, small.folder) == f"none of CAV {first.egos[0].id}, which did not arrive"
