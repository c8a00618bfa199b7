"""`learn train`, `learn export` and `learn evaluate` one after the other, on made-up samples."""

import json
from pathlib import Path

import numpy as np
import pytest
import torch
from click.testing import CliRunner, Result

from mdrive_sumo.agents.learned.system_spec import SYSTEMS, SystemSpec
from mdrive_sumo.cli import main
from mdrive_sumo.learning import sample_reader
from mdrive_sumo.learning.synthetic_samples import build_synthetic_arrays
from mdrive_sumo.learning.training import run_training as running
from mdrive_sumo.learning.training import smoke_test
from mdrive_sumo.learning.training.run_training import Arrays, TrainingRun
from mdrive_sumo.learning.training.trainer import Trainer
from mdrive_sumo.learning.training.training_options import TrainingOptions


def load(_: object, spec: SystemSpec, __: int) -> Arrays:
    """Twenty scenarios of two samples, at two places: one is held out."""
    return build_synthetic_arrays(spec, 40, seed=0) | {"scenario": np.arange(40, dtype=np.int32) // 2}


def run(*arguments: str) -> Result:
    return CliRunner().invoke(main, ["learn", *arguments])


@pytest.fixture(autouse=True)
def made_up_data(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sample_reader, "load_arrays", load)


@pytest.mark.usefixtures("drawn_curves")
@pytest.mark.parametrize("system", ["tcp", "vad"])
def test_from_data_to_weights_that_are_measured(system: str, tmp_path: Path) -> None:
    out, weights, metrics = tmp_path / "run", tmp_path / "weights", tmp_path / "new" / "open-loop.json"
    steps = ("--steps", "2", "--batch", "2", "--device", "cpu")
    trained = run("train", system, "--data", str(tmp_path), "--out", str(out), *steps)
    assert trained.exit_code == 0, trained.output
    assert "20 samples in the memory of cpu" in trained.output and "constant velocity 0.000 m" in trained.output
    assert {"checkpoint.pt", "weights.pt", "curves.csv", "curves.png", "validation.json"} <= {
        path.name for path in out.iterdir()
    }
    exported = run("export", system, "--checkpoint", str(out), "--out", str(weights), "--data", str(tmp_path))
    assert exported.exit_code == 0 and "differs from PyTorch by" in exported.output
    network = str(weights / f"{system}.onnx")
    judged = run("evaluate", system, "--data", str(tmp_path), "--weights", network, "--out", str(metrics))
    assert judged.exit_code == 0 and "40 samples; " in judged.output
    found = json.loads(metrics.read_text())
    assert found["system"] == system and found["plan"]["ade_3s_m"] > found["constant_velocity"]["ade_3s_m"]
    assert ("control_l1" in found) == SYSTEMS[system].answers_control


def test_a_training_is_not_overwritten(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(smoke_test, "STEPS", 20)  # the first and the last ten
    steps = ("--data", str(tmp_path), "--out", str(tmp_path), "--steps", "2", "--batch", "2", "--device", "cpu")
    assert run("train", "tcp", *steps).exit_code == 0
    before = (tmp_path / "checkpoint.pt").read_bytes()
    again = run("train", "tcp", *steps)
    assert again.exit_code == 2 and "expected no training there, found one; --resume goes on" in again.output
    assert run("train", "tcp", "--smoke", "--device", "cpu", "--out", str(tmp_path)).exit_code == 0
    assert (tmp_path / "checkpoint.pt").read_bytes() == before


def test_nothing_is_resumed_where_nothing_is(tmp_path: Path) -> None:
    result = run("train", "tcp", "--data", str(tmp_path), "--out", str(tmp_path), "--device", "cpu", "--resume")
    assert result.exit_code == 2 and "--resume: expected a training to go on with" in result.output


def test_ctrl_c_says_how_to_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(training: TrainingRun, _: object) -> Path:
        Trainer("tcp", training.options, torch.device("cpu")).save(training.folder)
        raise KeyboardInterrupt

    monkeypatch.setattr(running, "run_training", interrupt)
    result = run("train", "tcp", "--data", str(tmp_path), "--out", str(tmp_path / "out"), "--device", "cpu")
    assert result.exit_code == 130 and "interrupted; --resume goes on with" in result.output


def test_numbers_are_numbers(tmp_path: Path) -> None:
    result = run("train", "tcp", "--data", str(tmp_path), "--out", str(tmp_path), "--learning-rate", "nan")
    assert result.exit_code == 2 and "expected a number, found 'nan'" in result.output


def test_metrics_that_cannot_be_written_are_noticed_first(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    result = run("evaluate", "tcp", "--data", str(tmp_path), "--out", str(tmp_path / "file" / "metrics.json"))
    assert result.exit_code == 2 and "cannot be written" in result.output


def test_training_needs_data(tmp_path: Path) -> None:
    result = run("train", "tcp", "--device", "cpu", "--out", str(tmp_path))
    assert result.exit_code == 2
    assert "--data: expected at least one data set of `learn data`, found none" in result.output


def test_weights_of_another_system_are_refused(tmp_path: Path) -> None:
    Trainer("tcp", TrainingOptions(), torch.device("cpu")).save(tmp_path / "run")
    result = run("export", "vad", "--checkpoint", str(tmp_path / "run"), "--out", str(tmp_path))
    assert result.exit_code == 2 and "expected a checkpoint of 'vad', found one of 'tcp'" in result.output
