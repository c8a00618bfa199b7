"""run_fusion_training: frames in; checkpoint, best checkpoint and curves out."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import nn

from mdrive_sumo.agents.learned.fusion_spec import CODRIVING, SHARING
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.fusion.average_precision import compute_precision
from mdrive_sumo.learning.fusion.conditions import CONDITIONS, SharingCondition
from mdrive_sumo.learning.fusion.frames import FusionFrames, check_motion, check_places_differ, take_frames
from mdrive_sumo.learning.fusion.networks.fusion_network import FusionNetwork
from mdrive_sumo.learning.fusion.training.detect_frames import detect_frames, measure_forecast
from mdrive_sumo.learning.fusion.training.export_fusion import build_trained_network
from mdrive_sumo.learning.fusion.training.frame_store import FrameStore
from mdrive_sumo.learning.fusion.training.fusion_trainer import FusionTrainer
from mdrive_sumo.learning.training.checkpoint import (
    CHECKPOINT_NAME,
    Checkpoint,
    check_unused,
    load_checkpoint,
    load_whole_checkpoint,
    save_checkpoint,
)
from mdrive_sumo.learning.training.run_training import find_device, report_small_memory
from mdrive_sumo.learning.training.training_options import TrainingOptions

BEST_NAME = "best.pt"
"""The averaged weights with the highest average precision on the validation frames."""
JUDGED_BY = ("clean", "0.2 m, 100 ms")
"""Conditions whose mean precision of vehicles at an intersection over union of 0.5 decides which weights are best; the
second one is V2XSet's noise."""


MAX_JUDGED = 200
"""Validation frames that are looked at ten times in a run, spread over all: boxes are decoded on one core."""


@dataclass(frozen=True, slots=True)
class FusionRun:
    """What to train on what, and where it is written."""

    detector: str
    options: TrainingOptions
    device: str
    folder: Path
    data: FusionFrames
    validation: FusionFrames
    is_gated: bool = False
    is_alone: bool = False
    """Train without anything that others send."""
    is_resumed: bool = False
    """Go on from the checkpoint in `folder`, if there is one."""
    initial: Path | None = None
    """Checkpoint of any detector whose encoder and head the training begins with."""
    teacher: Path | None = None
    """Checkpoint of a trained `early`, for `disconet`."""
    sources: tuple[str, ...] = ()
    """Where the data comes from, for the summary."""


def find_best_weights(path: Path, option: str) -> Path:
    """Return the checkpoint that an option names: a file, or the best weights in the folder of a training.

    Raises InputError for none.
    """
    file = path / BEST_NAME if path.is_dir() else path
    if not file.is_file():
        raise InputError(f"{option} {file}: expected a checkpoint of `learn train-detector`, found no file")
    return file


def check_teacher(detector: str, teacher: Path | None) -> None:
    """Raise InputError unless `disconet`, and no other detector, has a teacher."""
    if detector == "disconet" and teacher is None:
        raise InputError("training disconet: expected --teacher with a trained 'early', found none")
    if detector != "disconet" and teacher is not None:
        raise InputError(f"training {detector}: expected no --teacher, which only disconet has, found {teacher}")


def run_fusion_training(run: FusionRun, report: Callable[[str], object]) -> Path:
    """Train a detector and return the path of its best weights. Raises InputError."""
    with report_small_memory(run.detector, run.options.batch, run.folder / BEST_NAME):
        return _run(run, report)


def _run(run: FusionRun, report: Callable[[str], object]) -> Path:
    check_places_differ(run.data, run.validation, "validation")
    if run.detector == CODRIVING:
        check_motion(run.data, "training set")
        check_motion(run.validation, "validation set")
    device = find_device(run.device)
    check_teacher(run.detector, run.teacher)
    teacher = None if run.teacher is None else build_trained_network(load_checkpoint(run.teacher, "early"))
    trainer = FusionTrainer(
        run.detector, run.options, device, report, is_gated=run.is_gated, is_alone=run.is_alone, teacher=teacher
    )
    _prepare(trainer, run, report)
    trainer.summary |= {
        "frames": len(run.data),
        "options": asdict(run.options),
        "sources": list(run.sources),
        "device": torch.cuda.get_device_name(device) if device.type == "cuda" else "CPU",
        "torch": str(torch.__version__),
    }
    data = FrameStore(run.data, device)
    judge = _BestWeights(trainer, data, run.validation, run.folder)
    trainer.train(data, np.ones(len(run.data)), run.folder, judge.look)
    judge.look(trainer.average.network)
    trainer.save(run.folder)
    best = trainer.summary["best"]
    report(f"{run.detector}: best average precision of validation {best['precision']:.4f} at step {best['step']}")
    return run.folder / BEST_NAME


def _prepare(trainer: FusionTrainer, run: FusionRun, report: Callable[[str], object]) -> None:
    path = run.folder / CHECKPOINT_NAME
    if run.is_resumed and path.is_file():
        checkpoint = load_whole_checkpoint(path, run.detector)
        _check_resumed(path, checkpoint.summary, run)
        trainer.resume(checkpoint)
        report(f"{path}: going on from step {trainer.step}")
        return
    check_unused(run.folder)
    if run.initial is not None:
        checkpoint = load_checkpoint(run.initial)
        trainer.begin_with(checkpoint)
        trainer.summary["begun_with"] = {"checkpoint": str(run.initial), "detector": checkpoint.system}


def _check_resumed(path: Path, before: Mapping[str, Any], run: FusionRun) -> None:
    """Raise InputError unless a checkpoint is of a run on the same frames, with the options that make it the same."""
    options = before.get("options", {})
    pairs = {
        "frames": (before.get("frames"), len(run.data)),
        "sources": (before.get("sources"), list(run.sources)),
        "gate": (before.get("is_gated"), run.is_gated and run.detector in SHARING),
        "alone": (before.get("is_alone"), run.is_alone or run.detector == "none"),
        "seed": (options.get("seed"), run.options.seed),
        "batch": (options.get("batch"), run.options.batch),
    }
    for what, (then, here) in pairs.items():
        if then != here:
            raise InputError(
                f"{path}: {what}: expected {then}, as the training began, found {here}; begin another training with its"
                " weights"
            )


class _BestWeights:
    """Measures the averaged network and keeps the weights that are best so far, also over a resumed run."""

    def __init__(self, trainer: FusionTrainer, data: FrameStore, frames: FusionFrames, folder: Path) -> None:
        self._trainer = trainer
        self._data = data
        rows = np.linspace(0, len(frames) - 1, min(MAX_JUDGED, len(frames))).astype(np.int64)
        self._frames = take_frames(frames, rows)
        self._store = FrameStore(self._frames, trainer.device)
        self._folder = folder

    def look(self, network: nn.Module) -> Mapping[str, float]:
        """Return average precisions by condition, and the overlap of a forecast, for the curves.

        Write BEST_NAME if their mean is the highest.
        """
        assert isinstance(network, FusionNetwork)
        self._trainer.settle(network, self._data)
        precision = {
            f"validation/{condition.name}": self._measure(network, condition)
            for condition in CONDITIONS
            if condition.name in JUDGED_BY
        }
        if network.forecast is not None:
            precision["validation/occupancy"] = measure_forecast(network, self._frames, self._store)
        mean = float(np.mean(list(precision.values())))
        best = self._trainer.summary.get("best")
        if best is None or mean > best["precision"]:
            self._trainer.summary["best"] = {"precision": mean, "step": self._trainer.step}
            summary = self._trainer.summary | {"steps": self._trainer.step}
            weights = Checkpoint(
                self._trainer.system,
                self._trainer.step,
                self._trainer.elapsed_s,
                {},
                network.state_dict(),
                {},
                None,
                summary,
            )
            save_checkpoint(weights, self._folder, BEST_NAME)
        return precision

    def _measure(self, network: FusionNetwork, condition: SharingCondition) -> float:
        return compute_precision(self._frames, detect_frames(network, self._frames, self._store, condition), 0.5)
