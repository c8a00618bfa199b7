"""Training scenarios as a suite: those of `learn data`, at places that no suite has."""

from pathlib import Path

import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.training_scenarios import build_training_scenario
from mdrive_sumo.rl.env_settings import EnvSettings
from mdrive_sumo.rl.training_suite import write_training_suite
from mdrive_sumo.scenario.suite import load_suite


@pytest.mark.slow
def test_a_training_suite_has_the_scenarios_of_training_data(tmp_path: Path) -> None:
    ids = write_training_suite(tmp_path / "suite", 3, seed=1)
    suite = load_suite(str(tmp_path / "suite"))
    assert [one.id for one in suite] == sorted(ids)
    built = build_training_scenario("train", 1, 1, tmp_path / "places")
    assert built is not None
    assert suite[ids[1]] == built[0]
    settings = EnvSettings(curriculum=[{"suite": str(tmp_path / "suite"), "episodes": 2}, {"suite": "interdrive@0"}])
    assert settings.choose_episode(0, 1, {}).scenario in ids


@pytest.mark.parametrize(
    ("count", "split", "sentence"),
    [
        (0, "train", "training suite: scenarios: expected at least 1, found 0"),
        (1, "trian", "split: expected one of train, val, test, found 'trian'"),
    ],
)
def test_bad_training_suites_are_one_sentence(tmp_path: Path, count: int, split: str, sentence: str) -> None:
    with pytest.raises(InputError) as error:
        write_training_suite(tmp_path / "suite", count, split=split)
    assert str(error.value) == sentence
    assert not list(tmp_path.iterdir())
