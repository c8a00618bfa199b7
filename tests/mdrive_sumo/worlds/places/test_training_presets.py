"""The plans of the training networks make the recipes that are packaged."""

import shutil
from pathlib import Path

import pytest
from testing.sampling import sampled

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.generate.network_choice import is_for_training
from mdrive_sumo.roads import list_packaged_networks
from mdrive_sumo.roads.netconvert import find_netconvert
from mdrive_sumo.worlds.places.recipe import build_draft
from mdrive_sumo.worlds.places.training_presets import TRAINING_PLANS, draw_training_network

LARGEST_KIB = 1536


def test_every_training_network_has_a_plan() -> None:
    assert set(TRAINING_PLANS) == set(filter(is_for_training, list_packaged_networks()))


def test_training_networks_stay_small() -> None:
    folders = [folder for name, folder in list_packaged_networks().items() if is_for_training(name)]
    assert sum(file.stat().st_size for folder in folders for file in folder.iterdir()) < LARGEST_KIB * 1024


@pytest.mark.slow
@pytest.mark.parametrize("name", sampled(sorted(TRAINING_PLANS), ("train_tee", "train_roundabout", "train_town")))
def test_the_plan_makes_the_packaged_files(name: str, tmp_path: Path) -> None:
    try:
        find_netconvert()
    except InputError:
        pytest.skip("needs netconvert")
    build_draft(draw_training_network(name), tmp_path / name)
    made, packaged = tmp_path / name, list_packaged_networks()[name]
    assert sorted(file.name for file in made.iterdir()) == sorted(file.name for file in packaged.iterdir())
    for file in made.iterdir():
        assert file.read_bytes() == (packaged / file.name).read_bytes(), file.name
    shutil.rmtree(made)
