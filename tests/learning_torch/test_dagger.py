"""Rounds of DAgger: the weights of a round drive, and the next round trains on all data so far."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mdrive_sumo.agents.learned.model_weights import load_network
from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.core.onnx_manifest import write_manifest
from mdrive_sumo.learning import collection as collecting
from mdrive_sumo.learning.collection import RoundPlan, collect_round
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.sample_format import SCENARIOS_PER_PLACE, DatasetFile
from mdrive_sumo.learning.synthetic_samples import build_synthetic_arrays
from mdrive_sumo.learning.training.checkpoint import load_checkpoint
from mdrive_sumo.learning.training.dagger import LATER_RATE, DaggerData, train_in_rounds
from mdrive_sumo.learning.training.run_training import Arrays, TrainingRun
from mdrive_sumo.learning.training.training_options import TrainingOptions

SPEC = SYSTEMS["tcp"]


def load(folders: tuple[Path, ...]) -> Arrays:
    """Forty samples for each folder, one a scenario."""
    arrays = build_synthetic_arrays(SPEC, 40 * len(folders), seed=0)
    return arrays | {"scenario": np.arange(40 * len(folders), dtype=np.int32)}


def test_each_round_drives_with_the_weights_of_the_one_before(tmp_path: Path) -> None:
    driven: list[tuple[int, str]] = []

    def collect(number: int, weights: Path, folder: Path) -> None:
        load_network(SPEC, weights, use_gpu=False)
        driven.append((number, str(folder.relative_to(tmp_path))))

    run = TrainingRun("tcp", TrainingOptions(steps=2, batch=2), "cpu", tmp_path, {})
    data = DaggerData((tmp_path / "first",), collect, load)
    checkpoint = load_checkpoint(train_in_rounds(run, data, 3, lambda _: None), "tcp")
    assert driven == [(1, "round-1/data"), (2, "round-2/data")]
    assert checkpoint.summary["sources"] == [str(tmp_path / name) for name in ("first", *(name for _, name in driven))]
    assert checkpoint.summary["samples"] == 120 - SCENARIOS_PER_PLACE
    assert checkpoint.summary["options"]["learning_rate"] == LATER_RATE * run.options.learning_rate
    earlier = checkpoint.summary["begun_with"]
    assert earlier["checkpoint"].endswith("round-1/checkpoint.pt") and earlier["steps"] == 2
    assert earlier["begun_with"]["checkpoint"].endswith("round-0/checkpoint.pt")
    lines: list[str] = []
    train_in_rounds(replace(run, is_resumed=True), data, 3, lines.append)
    assert sum("going on from step 2" in line for line in lines) == 3


def test_a_round_is_collected_as_the_first_data_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    made = DatasetFile(
        program="0", split="train", seed=7, expert="single", rigs=("tcp",), perturbation=0.5, driver="", mix=0.0,
        round=0, requested=4, samples=0, shards=(),
    )  # fmt: skip
    (tmp_path / "dataset.json").write_text(made.model_dump_json())
    weights = tmp_path / "tcp.onnx"
    write_manifest(WeightsManifest(system="tcp", sha256="0" * 64, bytes=1, parameters=1), tmp_path / "tcp.json")
    weights.touch()
    found: list[tuple[CollectionSettings, Path, int, int]] = []

    def note(
        settings: CollectionSettings, folder: Path, scenarios: int, workers: int, *_: object, **__: object
    ) -> None:
        found.append((settings, folder, scenarios, workers))

    monkeypatch.setattr(collecting, "collect_dataset", note)
    collect_round(RoundPlan(tmp_path, tmp_path / "places", 12, 3), 2, weights, tmp_path / "data", progress=None)  # pyright: ignore[reportArgumentType]
    ((settings, folder, scenarios, workers),) = found
    assert (folder, scenarios, workers) == (tmp_path / "data", 12, 3)
    assert (settings.split, settings.seed, settings.expert, settings.rigs) == ("train", 7, "single", ("tcp",))
    assert (settings.perturbation, settings.round, settings.driver) == (0.5, 2, weights)
    assert settings.places == tmp_path / "places"
