"""run_training: data in, checkpoint, curves and a first evaluation out."""

import json
from collections import Counter
from collections.abc import Callable, Generator
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.learning.held_out import find_held_out
from mdrive_sumo.learning.plan_metrics import compute_shares, name_kinds
from mdrive_sumo.learning.training.checkpoint import (
    CHECKPOINT_NAME,
    WEIGHTS_NAME,
    Checkpoint,
    check_unused,
    load_checkpoint,
    load_whole_checkpoint,
)
from mdrive_sumo.learning.training.trainer import Trainer
from mdrive_sumo.learning.training.training_data import TrainingData
from mdrive_sumo.learning.training.training_options import TrainingOptions
from mdrive_sumo.learning.training.validation import Arrays, Validation

VALIDATION_NAME = "validation.json"
TOLD_OF_EARLIER = ("samples", "sources", "steps", "minutes", "begun_with")
"""What the summary keeps of a training that it began with."""
Report = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class TrainingRun:
    """What to train on what, and where it is written."""

    system: str
    options: TrainingOptions
    device: str
    folder: Path
    data: dict[str, npt.NDArray[Any]]
    """Loses its images when they lie on a GPU."""
    validation: Arrays | None = None
    """None: a part of `data` is held out."""
    is_resumed: bool = False
    """Go on from the checkpoint in `folder`, if there is one."""
    initial: Path | None = None
    """Checkpoint whose averaged weights the training begins with."""
    sources: tuple[str, ...] = ()
    """Where the data comes from, for the summary."""


def run_training(run: TrainingRun, report: Report) -> Path:
    """Train, validate and return the path of the checkpoint. Raises InputError."""
    with report_small_memory(run.system, run.options.batch, run.folder / WEIGHTS_NAME):
        return _run(run, report)


@contextmanager
def report_small_memory(system: str, batch: int, weights: Path) -> Generator[None]:
    """Raise InputError where a batch does not fit on the GPU. weights: what another training can begin with."""
    try:
        yield
    except torch.cuda.OutOfMemoryError:
        raise InputError(
            f"training {system}: the GPU's memory is too small for a batch of {batch}: give --batch"
            f" {max(1, batch // 2)} and another --out, and --init {weights} if that was written"
        ) from None


def _run(run: TrainingRun, report: Report) -> Path:
    device = find_device(run.device)
    trainer = Trainer(run.system, run.options, device, report)
    _prepare(trainer, run, report)
    data, shares, validation = _prepare_data(run, device)
    trainer.summary |= _describe_run(run, device, int(np.count_nonzero(shares)))
    _drop_copied_images(run, data)
    kinds = ", ".join(f"{kind} {count}" for kind, count in trainer.summary["kinds"].items())
    report(f"{run.system}: {trainer.summary['samples']} samples in the memory of {data.place}: {kinds}")
    trainer.train(data, shares, run.folder, validation.glance)
    found = validation.describe(trainer.copy_best())
    trainer.summary["validation"] = found
    write_text(run.folder / VALIDATION_NAME, json.dumps(found, indent=1) + "\n")
    report(
        f"validation: ADE over 3 s {found['plan']['ade_3s_m']:.3f} m, constant velocity"
        f" {found['constant_velocity']['ade_3s_m']:.3f} m, blind {found['blackout']['ade_3s_m']:.3f} m;"
        f" {', '.join(f'{name} {value:.3f}' for name, value in found['judged'].items())}"
    )
    return trainer.save(run.folder)


def find_device(name: str) -> torch.device:
    """Return the device. Raises InputError if it is missing."""
    if name == "cuda" and not torch.cuda.is_available():
        raise InputError(
            f"--device cuda: expected a GPU that PyTorch {torch.__version__} can use, found none; --device cpu is slow"
        )
    torch.backends.cudnn.benchmark = True  # all batches have one shape
    return torch.device(name)


def _prepare(trainer: Trainer, run: TrainingRun, report: Report) -> None:
    path = run.folder / CHECKPOINT_NAME
    if run.is_resumed and path.is_file():
        checkpoint = load_whole_checkpoint(path, run.system)
        _check_resumed(path, checkpoint, run)
        trainer.resume(checkpoint)
        report(f"{path}: going on from step {trainer.step}")
        return
    check_unused(run.folder)
    if run.initial is not None:
        checkpoint = load_checkpoint(run.initial, run.system)
        trainer.begin_with(checkpoint)
        told = {name: checkpoint.summary[name] for name in TOLD_OF_EARLIER if name in checkpoint.summary}
        trainer.summary["begun_with"] = {"checkpoint": str(run.initial)} | told


def _check_resumed(path: Path, checkpoint: Checkpoint, run: TrainingRun) -> None:
    """Raise InputError unless a checkpoint is of a run on the same data, with the options that make it the same."""
    before, now = checkpoint.summary, _describe_data(run) | {"options": asdict(run.options)}
    pairs = {name: (before.get(name), now[name]) for name in ("sources", "kinds")}
    options = before.get("options", {})
    pairs |= {
        f"--{name.replace('_', '-')}": (options.get(name), now["options"][name])
        for name in ("seed", "batch", "plan_head")
    }
    for what, (then, here) in pairs.items():
        if then != here:
            raise InputError(
                f"{path}: {what}: expected {then}, as the training began, found {here}; --init begins another training"
                " with its weights"
            )


def _prepare_data(run: TrainingRun, device: torch.device) -> tuple[TrainingData, npt.NDArray[np.float64], Validation]:
    """Return the samples, how often each is drawn, and what is validated on."""
    spec, shares = SYSTEMS[run.system], compute_shares(run.data)
    if run.validation is not None:
        rows = np.arange(len(run.validation["own"]))
        judged = TrainingData(spec, run.validation, device)  # first: it is read often, and small
        return TrainingData(spec, run.data, device), shares, Validation(judged, run.validation, rows)
    rows = find_held_out(run.data)
    shares[rows] = 0.0
    data = TrainingData(spec, run.data, device)
    return data, shares, Validation(data, run.data, rows)


def _drop_copied_images(run: TrainingRun, data: TrainingData) -> None:
    """Free the main memory of images that lie on a GPU: four trainings of 150 000 samples have 180 GB of them."""
    if data.place.type != "cpu":
        for image in data.spec.images:
            del run.data[image.name]


def _describe_run(run: TrainingRun, device: torch.device, samples: int) -> dict[str, Any]:
    where = torch.cuda.get_device_name(device) if device.type == "cuda" else "CPU"
    return _describe_data(run) | {
        "samples": samples,
        "options": asdict(run.options),
        "device": where,
        "torch": str(torch.__version__),
    }


def _describe_data(run: TrainingRun) -> dict[str, Any]:
    return {
        "kinds": dict(sorted(Counter(name_kinds(run.data).tolist()).items())),
        "sources": list(run.sources),
    }
