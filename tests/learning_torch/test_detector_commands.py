"""`learn train-detector`, `export-detector` and `evaluate-detectors` one after the other, on made-up frames."""

import json
from pathlib import Path

import pytest
import torch
from click.testing import CliRunner, Result

from mdrive_sumo.agents.learned.fusion_network import load_detector
from mdrive_sumo.cli import main
from mdrive_sumo.learning.fusion.frame_files import write_frames
from mdrive_sumo.learning.fusion.synthetic_frames import build_synthetic_frames
from mdrive_sumo.learning.fusion.training import fusion_smoke_test, run_fusion_training
from mdrive_sumo.learning.fusion.training.export_fusion import export_fusion
from mdrive_sumo.learning.training import trainer as training
from mdrive_sumo.learning.training.checkpoint import load_checkpoint

CPU = ("--device", "cpu")


def run(*arguments: str | Path) -> Result:
    return CliRunner().invoke(main, ["learn", *map(str, arguments)])


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("frames")
    for split in ("train", "val", "test"):
        write_frames(folder / split, split, [build_synthetic_frames(2, 0, boxes=6, split=split)])
    return folder


def test_from_frames_to_weights_and_tables(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "GLANCES", 1)
    trained = ("--data", data / "train", "--val", data / "val", "--steps", "1", "--batch", "1", *CPU)
    for name, more in (("none", ()), ("fcooper", ("--init", tmp_path / "none"))):
        result = run("train-detector", name, "--out", tmp_path / name, *trained, *more)
        assert result.exit_code == 0, result.output
        assert "2 frames of 12 places, 10 scans" in result.output
    again = run("train-detector", "none", "--out", tmp_path / "none", *trained)
    assert again.exit_code == 2 and "expected no training there, found one" in again.output
    exported = run("export-detector", "fcooper", "--checkpoint", tmp_path / "fcooper", "--out", tmp_path / "weights")
    assert exported.exit_code == 0 and "differ from PyTorch by" in exported.output
    assert load_detector("fcooper", tmp_path / "weights").name == "fcooper"
    measured = ("--data", data / "test", "--checkpoints", tmp_path, "--out", tmp_path / "tables", "--frames", "1", *CPU)
    for name in ("none", "fcooper"):
        result = run("evaluate-detectors", name, *measured)
        assert result.exit_code == 0, result.output
    page = json.loads((tmp_path / "tables" / "detectors.json").read_text())
    conditions = {row["condition"] for row in page["precisions"] if row["detector"] == "fcooper"}
    assert {"clean", "0.6 m", "300 ms", "its-g5", "lte-v2x", "2 packets"} <= conditions
    assert page["use"]["fcooper"]["1 packet"]["map_bytes"] <= page["use"]["fcooper"]["ideal"]["map_bytes"]
    assert "| fcooper | its-g5 |" in (tmp_path / "tables" / "detectors.md").read_text()
    missing = run("evaluate-detectors", "attfuse", *measured)
    assert missing.exit_code == 2 and "--checkpoints" in missing.output and "found no file" in missing.output


def test_a_fusion_learns_and_its_files_answer_as_pytorch(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(fusion_smoke_test, "STEPS", 30)  # 150 are needed to know the frames by heart
    monkeypatch.setattr(fusion_smoke_test, "LEAST_PRECISION", 0.0)
    result = run("train-detector", "attfuse", "--smoke", "--out", tmp_path)
    assert result.exit_code == 0 and "mean loss of the first 10 of 30 steps" in result.output
    exported = export_fusion(load_checkpoint(tmp_path / "smoke" / "weights.pt", "attfuse"), tmp_path)
    assert exported.difference < 1e-3


@pytest.mark.parametrize(
    ("detector", "options", "expected"),
    [
        ("none", (), "--data: expected at least one data set of `learn scans`, found none"),
        ("none", ("--data", "train"), "--val: expected at least one data set of `learn scans`, found none"),
        ("none", ("--data", "none", "--val", "val"), "expected the index of fusion frames, found"),
        (
            "none",
            ("--data", "train", "--val", "train"),
            "places of the validation set: expected none of the training set",
        ),
        (
            "disconet",
            ("--data", "train", "--val", "val"),
            "training disconet: expected --teacher with a trained 'early'",
        ),
        ("cobevt", ("--data", "train", "--val", "val", "--teacher", "train/frames.json"), "expected no --teacher"),
        ("none", ("--data", "train", "--val", "val", "--init", "train"), "found no file"),
        ("none", ("--data", "train", "--val", "val", "--resume"), "--resume: expected a training to go on with in"),
        ("late", ("--data", "train"), "Invalid value for '{none|early"),
    ],
)
def test_what_cannot_be_trained_is_one_sentence(
    detector: str, options: tuple[str, ...], expected: str, data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(data)
    result = run("train-detector", detector, "--out", tmp_path, *options, *CPU)
    assert result.exit_code == 2 and expected in result.output, result.output


def test_a_gpu_that_is_missing_and_another_grid_are_one_sentence(data: Path, tmp_path: Path) -> None:
    arguments = ("train-detector", "none", "--data", data / "train", "--val", data / "val", "--out", tmp_path / "out")
    if not torch.cuda.is_available():
        result = run(*arguments)
        assert result.exit_code == 2 and "--device cuda: expected a GPU that PyTorch" in result.output
    index = json.loads((data / "train" / "frames.json").read_text())
    (tmp_path / "frames.json").write_text(json.dumps(index | {"grid_version": 7}))
    result = run(*arguments, "--data", tmp_path, *CPU)
    assert result.exit_code == 2 and "expected scans in the point grid of version 1, found 7" in result.output


def test_ctrl_c_says_how_to_go_on(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: object) -> Path:
        raise KeyboardInterrupt

    monkeypatch.setattr(run_fusion_training, "run_fusion_training", interrupt)
    arguments = ("--data", data / "train", "--val", data / "val", "--out", tmp_path / "out", *CPU)
    result = run("train-detector", "none", *arguments)
    assert result.exit_code == 130 and "interrupted; nothing is kept in" in result.output
