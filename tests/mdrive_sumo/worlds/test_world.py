"""Worlds: networks by name, folder or draw, and scenarios drawn on them."""

from pathlib import Path

import pytest
from testing.made_network import compile_tee, save_network

import mdrive_sumo as md
from mdrive_sumo.scenario.spawn_overlaps import find_spawn_overlaps
from mdrive_sumo.worlds import World


@pytest.mark.slow
def test_a_drawn_place_is_the_same_in_the_cache_and_in_a_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    cached, kept = (md.worlds.draw(place="crossing", seed=7, folder=folder) for folder in (None, tmp_path / "mine"))
    assert cached.folder.is_relative_to(tmp_path / "cache" / "mdrive-sumo")
    assert kept.folder == tmp_path / "mine"
    assert cached.name == kept.name and cached.roads.checksum == kept.roads.checksum
    assert md.worlds.draw(place="crossing", seed=8).roads.checksum != kept.roads.checksum
    with pytest.raises(md.InputError, match="expected a new or empty folder"):
        md.worlds.draw(place="crossing", seed=7, folder=tmp_path / "mine")


def test_a_packaged_network_is_drawn_by_its_name() -> None:
    assert md.worlds.draw(place="old_town").folder == md.worlds.load("old_town").folder
    assert repr(md.worlds.load("old_town")) == "World('old_town', 8 lanes, 41 buildings)"


def test_a_cache_that_cannot_be_written_is_one_sentence(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").touch()
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    with pytest.raises(md.InputError, match="cannot be written"):
        md.worlds.draw(place="crossing", seed=7)


@pytest.fixture(scope="module")
def tee(tmp_path_factory: pytest.TempPathFactory) -> World:
    folder = tmp_path_factory.mktemp("tee")
    return World(save_network(folder / "tee", compile_tee(folder / "plain")))


@pytest.mark.parametrize("name", ["old_town", "avenue", "roundabout", "motorway", "tee"])
@pytest.mark.parametrize("seed", range(4))
def test_a_scenario_is_drawn_on_any_network(tee: World, name: str, seed: int) -> None:
    world = tee if name == "tee" else md.worlds.load(name)
    scenario = world.scenario(seed, cavs=2)
    assert scenario == world.scenario(seed, cavs=2)
    assert len(scenario.egos) == 2 and scenario.id == f"{name}_{seed}"
    assert all(len(ego.route) > 20 for ego in scenario.egos)
    assert not list(find_spawn_overlaps(scenario, world.roads))


def test_drawn_cavs_come_to_one_junction_from_different_lanes() -> None:
    world = md.worlds.load("old_town")
    scenarios = [world.scenario(seed, cavs=3) for seed in range(5)]
    assert all(len({ego.lanes[0] for ego in scenario.egos}) == 3 for scenario in scenarios)
    assert all(any(lane.startswith(":x_") for lane in ego.lanes) for one in scenarios for ego in one.egos)
    assert len({tuple(ego.lanes for ego in one.egos) for one in scenarios}) > 1


def test_too_many_cavs_for_a_network_are_one_sentence(tee: World) -> None:
    with pytest.raises(md.InputError, match="network tee: expected room for 9 CAVs that meet, found none in 40 draws"):
        tee.scenario(0, cavs=9)
    with pytest.raises(md.InputError, match="town-quiet"):
        tee.scenario(0, demand="rush")
    with pytest.raises(md.InputError, match="cavs: expected 1 to 32, found 0"):
        tee.scenario(0, cavs=0)
