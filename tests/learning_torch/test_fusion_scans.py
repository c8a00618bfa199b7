"""From drives to a trained detector: `learn scans`, its reader, a few steps of training."""

from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from testing.local_executor import LocalExecutor
from testing.training_data import make_suite

from mdrive_sumo.cli import main
from mdrive_sumo.learning.fusion.frame_files import read_frames
from mdrive_sumo.learning.fusion.synthetic_frames import build_synthetic_frames
from mdrive_sumo.learning.fusion.training.run_fusion_training import FusionRun, run_fusion_training
from mdrive_sumo.learning.training.training_curves import read_curves
from mdrive_sumo.learning.training.training_options import TrainingOptions

pytestmark = pytest.mark.slow


def test_frames_of_drives_train_a_detector(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mdrive_sumo.learning.collection.make_executor", LocalExecutor)
    suite = make_suite(tmp_path / "suite")
    words = ["--split", "train", "--scenarios", "1", "--interval-s", "1", "--suite", str(suite)]
    ended = CliRunner().invoke(main, ["learn", "scans", *words, "--out", str(tmp_path / "set")])
    assert ended.exit_code == 0, ended.output
    frames = read_frames(tmp_path / "set")
    options = TrainingOptions(steps=2, batch=1, learning_rate=2e-3, log_every=1, average_decay=0.9)
    judged = build_synthetic_frames(1, 0, split="val")
    run_fusion_training(FusionRun("fcooper", options, "cpu", tmp_path / "out", frames, judged), str)
    losses = [value for _, name, value in read_curves(tmp_path / "out/curves.csv") if name == "loss/total"]
    assert len(losses) == 2 and np.isfinite(losses).all()
