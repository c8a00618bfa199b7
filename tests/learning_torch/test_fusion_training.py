"""Training of detectors: the loss falls, runs go on, the best weights stay, and errors are sentences."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.fusion.average_precision import compute_precision
from mdrive_sumo.learning.fusion.conditions import CONDITIONS
from mdrive_sumo.learning.fusion.frames import FusionFrames
from mdrive_sumo.learning.fusion.networks.fusion_network import FusionNetwork
from mdrive_sumo.learning.fusion.synthetic_frames import build_synthetic_frames
from mdrive_sumo.learning.fusion.training import run_fusion_training as running
from mdrive_sumo.learning.fusion.training.detect_frames import detect_frames
from mdrive_sumo.learning.fusion.training.frame_store import FrameStore
from mdrive_sumo.learning.fusion.training.fusion_trainer import FusionTrainer
from mdrive_sumo.learning.fusion.training.run_fusion_training import BEST_NAME, FusionRun, run_fusion_training
from mdrive_sumo.learning.training import trainer as training
from mdrive_sumo.learning.training.checkpoint import load_checkpoint
from mdrive_sumo.learning.training.training_curves import read_curves
from mdrive_sumo.learning.training.training_options import TrainingOptions

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def frames() -> FusionFrames:
    return build_synthetic_frames(4, 0, boxes=12)


@pytest.fixture(scope="module")
def judged() -> FusionFrames:
    return build_synthetic_frames(1, 0, split="val")


def make_run(
    frames: FusionFrames, judged: FusionFrames, folder: Path, detector: str = "none", steps: int = 2
) -> FusionRun:
    options = TrainingOptions(steps=steps, batch=1, learning_rate=2e-3, log_every=1, average_decay=0.9)
    return FusionRun(detector, options, "cpu", folder, frames, judged)


def test_the_best_weights_are_kept_and_the_rate_is_told(
    frames: FusionFrames, judged: FusionFrames, tmp_path: Path
) -> None:
    told: list[str] = []
    best = run_fusion_training(make_run(frames, judged, tmp_path, steps=2), told.append)
    rows = read_curves(tmp_path / "curves.csv")
    assert {"validation/clean", "validation/0.2 m, 100 ms"} <= {name for _, name, _ in rows}
    kept = load_checkpoint(best, "none")
    assert kept.summary["best"]["step"] <= 2 and kept.summary["frames"] == 4
    assert "samples/s): centre" in told[1] and told[-1].startswith("none: best average precision of validation")


def do_nothing(*_: object) -> None:
    """Stands for what a test does not need."""


def test_better_weights_replace_worse_ones_only(frames: FusionFrames, judged: FusionFrames, tmp_path: Path,
                                                monkeypatch: pytest.MonkeyPatch) -> None:  # fmt: skip
    values = iter((0.2, 0.2, 0.5, 0.5, 0.3, 0.3))

    def measure(*_: object) -> float:
        return next(values)

    monkeypatch.setattr(running, "compute_precision", measure)
    trainer = FusionTrainer("none", TrainingOptions(), CPU)
    monkeypatch.setattr(FusionTrainer, "settle", do_nothing)
    judge = running._BestWeights(trainer, FrameStore(frames, CPU), judged, tmp_path)
    for step in (1, 2, 3):
        trainer.step = step
        judge.look(trainer.average.network)
    assert load_checkpoint(tmp_path / BEST_NAME).step == 2
    assert trainer.summary["best"] == {"precision": 0.5, "step": 2}


def test_an_interrupted_run_ends_with_the_same_bits(
    frames: FusionFrames, judged: FusionFrames, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(training, "GLANCES", 2)
    run = make_run(frames, judged, tmp_path / "whole", "fcooper", steps=4)
    run_fusion_training(run, str)

    class Stopped(Exception):
        pass

    def stop_after(count: int) -> object:
        seen: list[str] = []

        def tell(line: str) -> None:
            seen.append(line)
            if len(seen) == count:
                raise Stopped

        return tell

    part = replace(run, folder=tmp_path / "part", options=replace(run.options, save_every_s=0.0))
    with pytest.raises(Stopped):
        run_fusion_training(part, stop_after(3))  # pyright: ignore[reportArgumentType]
    told: list[str] = []
    run_fusion_training(replace(part, is_resumed=True), told.append)
    assert "going on from step 2" in told[0]
    whole, resumed = (load_checkpoint(folder / "checkpoint.pt").network for folder in (run.folder, part.folder))
    assert all(torch.equal(value, resumed[name]) for name, value in whole.items())
    with pytest.raises(InputError, match="seed: expected 0, as the training began, found 5"):
        run_fusion_training(replace(part, is_resumed=True, options=replace(part.options, seed=5)), str)
    with pytest.raises(InputError, match="expected no training there, found one"):
        run_fusion_training(part, str)


@pytest.mark.parametrize("detector", ["early", "attfuse", "disconet", "cobevt"])
def test_every_detector_learns_a_step(detector: str, frames: FusionFrames, tmp_path: Path) -> None:
    teacher = FusionNetwork("early") if detector == "disconet" else None
    trainer = FusionTrainer(detector, TrainingOptions(batch=1), CPU, is_gated=True, teacher=teacher)
    before = {name: value.clone() for name, value in trainer.network.named_parameters()}
    parts = trainer._take_step(FrameStore(frames, CPU), torch.ones(4), 0.0)
    assert ("teacher" in parts) == (detector == "disconet") and torch.isfinite(parts["total"])
    still = [name for name, value in trainer.network.named_parameters() if torch.equal(value, before[name])]
    assert still == []


def test_settled_statistics_are_those_of_the_batches(frames: FusionFrames) -> None:
    trainer, store = FusionTrainer("none", TrainingOptions(batch=2), CPU), FrameStore(frames, CPU)
    network, first = trainer.average.network, trainer.average.network.encoder.stem[0]
    seen: list[torch.Tensor] = []

    def keep(_: torch.nn.Module, __: object, maps: torch.Tensor) -> None:
        seen.append(maps)

    hook = first[0].register_forward_hook(keep)
    trainer.settle(network, store)
    hook.remove()
    assert len(seen) == 5 and not network.training and not first[1].training and first[1].momentum == 0.02
    torch.testing.assert_close(first[1].running_mean, torch.stack([maps.mean(dim=(0, 2, 3)) for maps in seen]).mean(0))
    torch.testing.assert_close(first[1].running_var, torch.stack([maps.var(dim=(0, 2, 3)) for maps in seen]).mean(0))
    before = {name: value.clone() for name, value in network.state_dict().items()}
    trainer.settle(network, store)
    assert all(torch.equal(value, before[name]) for name, value in network.state_dict().items())


def test_half_precision_has_nearly_the_same_losses(frames: FusionFrames) -> None:
    losses = []
    for uses_bfloat16 in (False, True):
        trainer = FusionTrainer("cobevt", TrainingOptions(batch=1), CPU, is_gated=True)
        trainer.uses_bfloat16 = uses_bfloat16
        parts = trainer._take_step(FrameStore(frames, CPU), torch.ones(4), 0.0)
        losses.append({name: float(part.detach()) for name, part in parts.items()})
        assert all(
            bool(value.grad.isfinite().all()) for value in trainer.network.parameters() if value.grad is not None
        )
    assert losses[1] == pytest.approx(losses[0], rel=0.05) and losses[1] != losses[0]


def test_a_training_begins_with_encoder_and_head_of_another(tmp_path: Path) -> None:
    none = FusionTrainer("none", TrainingOptions(seed=3), CPU)
    none.save(tmp_path)
    other = FusionTrainer("attfuse", TrainingOptions(seed=4), CPU, is_gated=True)
    other.begin_with(load_checkpoint(tmp_path))
    assert torch.equal(other.network.encoder.narrow[0].weight, none.network.encoder.narrow[0].weight)
    assert torch.equal(other.average.network.head.heat.weight, none.network.head.heat.weight)


def test_what_cannot_be_trained_is_one_sentence(frames: FusionFrames, judged: FusionFrames, tmp_path: Path) -> None:
    run = make_run(frames, judged, tmp_path)
    with pytest.raises(
        InputError, match="places of the validation set: expected none of the training set, found 'train_0'"
    ):
        run_fusion_training(replace(run, validation=frames), str)
    with pytest.raises(InputError, match="detector 'late': expected one of none, early"):
        run_fusion_training(replace(run, detector="late"), str)


def test_all_detectors_are_measured_under_all_conditions(judged: FusionFrames) -> None:
    torch.manual_seed(0)
    network, store = FusionNetwork("none").eval(), FrameStore(judged, CPU)
    torch.nn.init.constant_(network.head.heat.bias, 1.0)  # finds something everywhere
    own = detect_frames(network, judged, store, CONDITIONS[0])
    late = detect_frames(network, judged, store, CONDITIONS[3], is_late=True)
    assert len(own) == len(late) == 1 and len(own[0].scores) > 0 and len(late[0].scores) > 0
    assert 0.0 <= compute_precision(judged, own, 0.5) <= 1.0
