"""run_dialogue_training: dialogues, or pairs of answers, in; checkpoint and curves out."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.dialogue.dialogue_samples import DialoguePairs, DialogueSamples, check_places_differ
from mdrive_sumo.learning.dialogue.training.dialogue_store import DialogueStore
from mdrive_sumo.learning.dialogue.training.dialogue_trainer import DialogueJudge, DialogueTrainer, PreferenceTrainer
from mdrive_sumo.learning.training.checkpoint import (
    CHECKPOINT_NAME,
    WEIGHTS_NAME,
    Checkpoint,
    check_unused,
    load_checkpoint,
    load_whole_checkpoint,
)
from mdrive_sumo.learning.training.run_training import find_device, report_small_memory
from mdrive_sumo.learning.training.training_options import TrainingOptions
from mdrive_sumo.negotiation.dialogue.decoder_shape import NEGOTIATOR, DecoderShape
from mdrive_sumo.negotiation.dialogue.dialogue_manifest import SYSTEM

SAME_OPTIONS = ("seed", "batch")
"""Options that a run that goes on shares with its beginning."""
Report = Callable[[str], object]


@dataclass(frozen=True, slots=True)
class DialogueRun:
    """What to train on what, and where it is written."""

    options: TrainingOptions
    device: str
    folder: Path
    data: DialogueSamples
    judged: DialogueSamples
    """Of places that are in no dialogue of `data`."""
    pairs: DialoguePairs | None = None
    """Learn from preferences, beginning with `initial`; None: from `data`."""
    is_resumed: bool = False
    """Go on from the checkpoint in `folder`, if there is one."""
    initial: Path | None = None
    """Checkpoint whose chosen weights the training begins with."""
    shape: DecoderShape = NEGOTIATOR


def run_dialogue_training(run: DialogueRun, report: Report) -> Path:
    """Train and return the path of the checkpoint. Raises InputError."""
    check_places_differ(run.data, run.judged)
    if run.pairs is not None and run.initial is None:
        raise InputError("training on pairs: expected --init with trained weights to begin with, found none")
    device = find_device(run.device)
    with report_small_memory(SYSTEM, run.options.batch, run.folder / WEIGHTS_NAME):
        return _run(run, device, report)


def _run(run: DialogueRun, device: torch.device, report: Report) -> Path:
    kind = DialogueTrainer if run.pairs is None else PreferenceTrainer
    trainer = kind(run.options, device, report, run.shape)
    _prepare(trainer, run, report)
    trainer.summary |= _describe_run(run, device)
    count = len(run.data) if run.pairs is None else len(run.pairs)
    report(f"{SYSTEM}: {count} {'dialogues' if run.pairs is None else 'pairs'}, {len(run.judged)} for validation")
    judge = DialogueJudge.build(run.judged, device)
    if isinstance(trainer, PreferenceTrainer):
        assert run.pairs is not None
        data: Any = trainer.prepare_pairs(run.pairs)
    else:
        data = DialogueStore(run.data, device)
    trainer.train(data, np.ones(count), run.folder, judge.look)
    trainer.summary["validation"] = found = judge.look(trainer.copy_best())
    report(
        f"validation: {1 - found['validation/wrong_head']:.1%} of the heads without a wrong entry, loss"
        f" {found['validation/head']:.3f} an entry of a head, {found['validation/words']:.3f} an entry of words"
    )
    return trainer.save(run.folder)


def _prepare(trainer: DialogueTrainer, run: DialogueRun, report: Report) -> None:
    path = run.folder / CHECKPOINT_NAME
    if run.is_resumed and path.is_file():
        checkpoint = load_whole_checkpoint(path, SYSTEM)
        check_vocabulary(path, checkpoint, run.data.vocabulary)
        _check_resumed(path, checkpoint, run)
        trainer.resume(checkpoint)
        report(f"{path}: going on from step {trainer.step}")
        return
    check_unused(run.folder)
    if run.initial is not None:
        checkpoint = load_checkpoint(run.initial, SYSTEM)
        check_vocabulary(run.initial, checkpoint, run.data.vocabulary)
        trainer.begin_with(checkpoint)
        trainer.summary["begun_with"] = {"checkpoint": str(run.initial), "steps": checkpoint.step}


def check_vocabulary(path: Path, checkpoint: Checkpoint, vocabulary: str) -> None:
    """Raise InputError if a checkpoint was trained with another vocabulary."""
    found = str(checkpoint.summary.get("vocabulary", ""))
    if found != vocabulary:
        raise InputError(
            f"{path}: expected weights of the vocabulary {vocabulary[:8]}..., found those of {found[:8]}...; train them"
            " with this version of mdrive-sumo"
        )


def _check_resumed(path: Path, checkpoint: Checkpoint, run: DialogueRun) -> None:
    """Raise InputError unless a checkpoint is of a run with as many dialogues and the same seed and batch."""
    options: Mapping[str, Any] = checkpoint.summary.get("options", {})
    pairs = {f"--{name}": (options.get(name), getattr(run.options, name)) for name in SAME_OPTIONS}
    pairs["dialogues"] = checkpoint.summary.get("dialogues"), len(run.data)
    pairs["pairs"] = checkpoint.summary.get("pairs"), 0 if run.pairs is None else len(run.pairs)
    for what, (then, now) in pairs.items():
        if then != now:
            raise InputError(f"{path}: {what}: expected {then}, as the training began, found {now}; --init begins anew")
    if run.pairs is not None:
        raise InputError(f"{path}: expected no --resume of a training on pairs, which compares with its beginning")


def _describe_run(run: DialogueRun, device: torch.device) -> dict[str, Any]:
    return {
        "vocabulary": run.data.vocabulary,
        "shape": asdict(run.shape),
        "dialogues": len(run.data),
        "pairs": 0 if run.pairs is None else len(run.pairs),
        "places": len(set(run.data.places)),
        "options": asdict(run.options),
        "device": torch.cuda.get_device_name(device) if device.type == "cuda" else "CPU",
        "torch": str(torch.__version__),
    }
