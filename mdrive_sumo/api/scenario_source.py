"""Find the scenario that a user names, and its road network."""

from pathlib import Path
from typing import NamedTuple, cast

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.suggestion import suggest_name
from mdrive_sumo.roads import RoadMap, find_network_folder, load_road_map
from mdrive_sumo.runs.run_config import read_seed
from mdrive_sumo.scenario.packaged_suites import list_exact_suites
from mdrive_sumo.scenario.scenario import Scenario, load_scenario
from mdrive_sumo.scenario.suite import SCENARIO_FILE, Suite, load_suite
from mdrive_sumo.scenario.variation import vary_scenario


class ScenarioSource(NamedTuple):
    """A scenario, its network, and the folder of the suite that it lies in; None: of no suite."""

    scenario: Scenario
    roads: RoadMap
    suite_folder: Path | None


def find_scenario(scenario: str | Scenario, suite: str | Suite | None = None, seed: int = 0) -> ScenarioSource:
    """Return a scenario as a seed draws it (seed 0: as written), with its network and the folder of its suite.

    scenario: an id, or a scenario itself. suite: a suite, its name or its folder; None: the packaged suites. A scenario
    whose network belongs to a suite of one's own needs that suite. Raises InputError.
    """
    if not isinstance(cast(object, scenario), str | Scenario):
        raise InputError(f"scenario: expected the id of a scenario, or a scenario, found {scenario!r:.40}")
    seed = read_seed(seed)
    written = _find_written(scenario, suite)
    return written._replace(scenario=vary_scenario(written.scenario, written.roads, seed))


def _find_written(scenario: str | Scenario, suite: str | Suite | None) -> ScenarioSource:
    if suite is not None:
        owner = suite if isinstance(suite, Suite) else load_suite(suite)
        found = scenario if isinstance(scenario, Scenario) else _find_in(owner, scenario)
        folder = owner.find_folder(found.id)
        return ScenarioSource(found, load_road_map(find_network_folder(found.network, folder)), folder)
    scenario_id = scenario.id if isinstance(scenario, Scenario) else scenario
    folder = _find_packaged_suite(scenario_id)
    if isinstance(scenario, Scenario):
        return ScenarioSource(scenario, load_road_map(find_network_folder(scenario.network, folder)), folder)
    if folder is None:
        ids = (path.parent.name for suite in list_exact_suites().values() for path in suite.glob(f"*/{SCENARIO_FILE}"))
        suggestion = suggest_name(str(scenario), ids)
        raise InputError(
            f"scenario {scenario!r}: expected the id of a scenario in a packaged suite, found none{suggestion}"
        )
    found = load_scenario(folder / scenario / SCENARIO_FILE)
    return ScenarioSource(found, load_road_map(find_network_folder(found.network, folder)), folder)


def _find_in(suite: Suite, scenario_id: str) -> Scenario:
    found = next((scenario for scenario in suite if scenario.id == scenario_id), None)
    if found is None:
        suggestion = suggest_name(scenario_id, (one.id for one in suite))
        raise InputError(
            f"scenario {scenario_id!r}: expected the id of a scenario in suite {suite.label}, found none{suggestion}"
        )
    return found


def _find_packaged_suite(scenario_id: str) -> Path | None:
    """Return the folder of the packaged suite that has a scenario, of the newest season; None if none has it.

    Loads nothing.
    """
    folders = list_exact_suites().values()
    return next((folder for folder in folders if (folder / scenario_id / SCENARIO_FILE).is_file()), None)
