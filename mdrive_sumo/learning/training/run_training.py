"""run_training: data in, checkpoint, curves and a first evaluation out."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from mdrive_sumo.agents.learned.system_spec import SYSTEMS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.held_out import find_held_out
from mdrive_sumo.learning.plan_metrics import describe_plans, measure_controls
from mdrive_sumo.learning.sample_kinds import compute_shares
from mdrive_sumo.learning.training.checkpoint import CHECKPOINT_NAME, load_checkpoint, load_whole_checkpoint
from mdrive_sumo.learning.training.predict_samples import predict_samples
from mdrive_sumo.learning.training.trainer import Trainer
from mdrive_sumo.learning.training.training_data import TrainingData
from mdrive_sumo.learning.training.training_options import TrainingOptions

VALIDATION_NAME = "validation.json"
MOST_VALIDATED = 20_000
Arrays = Mapping[str, npt.NDArray[Any]]
Report = Callable[[str], None]


@dataclass(frozen=True, slots=True)
class TrainingRun:
    """What to train on what, and where it is written."""

    system: str
    options: TrainingOptions
    device: str
    folder: Path
    data: Arrays
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
    device = find_device(run.device)
    trainer = Trainer(run.system, run.options, device, report)
    _prepare(trainer, run, report)
    shares = compute_shares(run.data)
    held_out = find_held_out(run.data) if run.validation is None else np.zeros(0, np.int64)
    shares[held_out] = 0.0
    data = TrainingData(SYSTEMS[run.system], run.data, device)
    trainer.summary |= _describe_run(run, device, int(np.count_nonzero(shares)))
    report(f"{run.system}: {trainer.summary['samples']} samples in the memory of {data.place}")
    trainer.train(data, shares, run.folder)
    if run.validation is None:
        found = validate(trainer, data, run.data, held_out)
    else:
        del data  # makes room on the GPU
        judged = TrainingData(SYSTEMS[run.system], run.validation, device)
        found = validate(trainer, judged, run.validation, np.arange(len(run.validation["own"])))
    trainer.summary["validation"] = found
    (run.folder / VALIDATION_NAME).write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    report(
        f"validation: ADE over 3 s {found['plan']['ade_3s_m']:.3f} m, constant velocity"
        f" {found['constant_velocity']['ade_3s_m']:.3f} m, blind {found['blackout']['ade_3s_m']:.3f} m"
    )
    return trainer.save(run.folder)


def find_device(name: str) -> torch.device:
    """Return the device. Raises InputError if it is missing."""
    if name == "cuda" and not torch.cuda.is_available():
        raise InputError(f"--device cuda: expected a GPU that PyTorch {torch.__version__} can use, found none")
    torch.backends.cudnn.benchmark = True  # all batches have one shape
    return torch.device(name)


def _prepare(trainer: Trainer, run: TrainingRun, report: Report) -> None:
    path = run.folder / CHECKPOINT_NAME
    if run.is_resumed and path.is_file():
        trainer.resume(load_whole_checkpoint(path, run.system))
        report(f"{path}: going on from step {trainer.step}")
    elif run.initial is not None:
        trainer.begin_with(load_checkpoint(run.initial, run.system))


def _describe_run(run: TrainingRun, device: torch.device, samples: int) -> dict[str, Any]:
    where = torch.cuda.get_device_name(device) if device.type == "cuda" else "CPU"
    return {
        "samples": samples,
        "sources": list(run.sources),
        "options": asdict(run.options),
        "device": where,
        "torch": str(torch.__version__),
        "initial": "" if run.initial is None else str(run.initial),
    }


def validate(trainer: Trainer, data: TrainingData, arrays: Arrays, rows: npt.NDArray[np.int64]) -> dict[str, Any]:
    """Return the open-loop metrics of the averaged weights on rows of `arrays`, with and without images."""
    rows = rows[:: max(1, -(-len(rows) // MOST_VALIDATED))]
    network = trainer.average.network
    seen = predict_samples(network, data, rows)
    blind = predict_samples(network, data, rows, blind=True)
    labels = {name: arrays[name][rows] for name in ("own", "expert_plan", "expert_control")}
    found = describe_plans(seen.plans, labels)
    found["blackout"] = describe_plans(blind.plans, labels)["plan"]
    if seen.controls is not None:
        found["control_l1"] = measure_controls(seen.controls, labels["expert_control"])
    return found
