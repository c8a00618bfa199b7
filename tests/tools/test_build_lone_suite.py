"""A CAV has the road to itself; everything else of its scenario stays."""

from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import find_network_folder
from mdrive_sumo.scenario.suite import load_suite
from tools.build_lone_suite import build_lone_scenario, write_lone_suite


def test_only_the_first_cav_stays() -> None:
    scenario = max(load_suite("interaction@0").scenarios, key=lambda one: len(one.actors))
    assert len(scenario.egos) > 1 and scenario.actors
    lone = build_lone_scenario(scenario)
    assert lone.egos == scenario.egos[:1]
    assert not lone.actors and not lone.background.vehicles and not lone.rsus
    assert (lone.network, lone.weather, lone.id) == (scenario.network, scenario.weather, scenario.id)


def test_the_suite_has_its_networks_and_is_never_overwritten(tmp_path: Path) -> None:
    write_lone_suite("mdrive@0", tmp_path / "lone")
    suite = load_suite(str(tmp_path / "lone"))
    assert [len(one.egos) for one in suite] == [1] * 225
    assert all(find_network_folder(one.network, suite.folder) for one in suite)
    with pytest.raises(InputError, match="expected a folder that does not exist yet"):
        write_lone_suite("mdrive@0", tmp_path / "lone")
