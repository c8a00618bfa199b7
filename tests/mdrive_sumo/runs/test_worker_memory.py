"""What a worker process loads: one scenario of the suite, and no library that it does not use."""

import subprocess
import sys
from pathlib import Path

import pytest

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob, load_job_scenario
from mdrive_sumo.scenario.packaged_suites import find_suite_folder, list_exact_suites
from mdrive_sumo.scenario.scenario import Scenario, load_scenario
from mdrive_sumo.scenario.suite import SCENARIO_FILE, Suite, SuiteFile, load_suite, load_suite_of_one, save_suite
from mdrive_sumo.scenario.variation import load_varied_scenario

CROSSWALK = "crosswalk_05"


@pytest.fixture
def whole(tmp_path: Path) -> Suite:
    """A suite of a packaged suite's scenario and of two in a folder beside it."""
    scenario = load_scenario(find_suite_folder("interdrive@0") / "i13_ins_sl_minor_road" / SCENARIO_FILE)
    two = (scenario.derive(id="one"), scenario.derive(id="two"))
    save_suite(Suite(SuiteFile(name="mine", title=""), tmp_path / "mine", two))
    save_suite(Suite(SuiteFile(name="both", title="", parts=("interdrive", "mine")), tmp_path / "both", ()))
    return load_suite(str(tmp_path / "both"))


@pytest.mark.slow
@pytest.mark.parametrize("name", ["one", "i13_ins_sl_minor_road"])
def test_a_job_finds_the_same_scenario_without_the_others(whole: Suite, name: str) -> None:
    alone = load_suite_of_one(whole.folder, name)
    assert alone.scenarios == tuple(one for one in whole if one.id == name)
    assert alone.find_folder(name) == whole.find_folder(name)
    expected: Scenario = load_varied_scenario(whole, alone.scenarios[0], 3)[0]
    assert load_job_scenario(EpisodeJob(whole.folder, name, AgentSpec("idm"), 3))[0] == expected


def test_an_unknown_scenario_gets_one_sentence() -> None:
    for name, folder in list_exact_suites().items():
        with pytest.raises(InputError, match=f"suite {name}: expected a scenario 'none', found none"):
            load_suite_of_one(folder, "none")


def test_a_scenario_that_changed_since_the_run_began_is_refused(tmp_path: Path) -> None:
    suite = find_suite_folder("interaction@0")
    save_suite(
        Suite(SuiteFile(name="mine", title=""), tmp_path, (load_scenario(suite / CROSSWALK / SCENARIO_FILE),)),
    )
    path = tmp_path / CROSSWALK / SCENARIO_FILE
    job = EpisodeJob(tmp_path, CROSSWALK, AgentSpec("idm"), checksum=compute_file_checksum(path))
    assert load_job_scenario(job)[0].id == CROSSWALK
    path.write_bytes(path.read_bytes() + b"\n")
    with pytest.raises(InputError, match="expected the scenario with which the run began, found a changed one"):
        load_job_scenario(job)


@pytest.mark.slow
def test_a_worker_loads_neither_projections_nor_pictures_nor_the_server() -> None:
    """In a fresh interpreter; afterwards pyproj can be imported as ever."""
    lines = (
        "import sys, mdrive_sumo.runs.episode_job",
        "from mdrive_sumo.roads import list_packaged_networks, load_road_map",
        "load_road_map(list_packaged_networks()['town_crossing'])",
        "unused = ('pyproj', 'matplotlib', 'scipy', 'pandas', 'fastapi', 'sqlalchemy')",
        "print([name for name in unused if name in sys.modules])",
        "import pyproj",
    )
    found = subprocess.run([sys.executable, "-c", "\n".join(lines)], capture_output=True, text=True, check=True)
    assert found.stdout.strip() == "[]"
