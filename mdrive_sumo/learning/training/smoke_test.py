"""run_smoke_test: 50 steps on 20 samples lower the loss, on any machine."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from mdrive_sumo.agents.learned.system_spec import PLAN_HEADS, SYSTEMS
from mdrive_sumo.learning.synthetic_samples import build_synthetic_arrays
from mdrive_sumo.learning.training.run_training import Arrays
from mdrive_sumo.learning.training.trainer import Trainer
from mdrive_sumo.learning.training.training_curves import read_curves
from mdrive_sumo.learning.training.training_data import TrainingData
from mdrive_sumo.learning.training.training_options import TrainingOptions

STEPS, SAMPLES, BATCH = 50, 20, 4
"""Size of a run that takes seconds on one core."""
COMPARED = 10
"""Steps at the beginning and at the end whose mean losses are compared."""


@dataclass(frozen=True, slots=True)
class SmokeResult:
    """Mean total loss of the first and of the last COMPARED steps."""

    first: float
    last: float

    @property
    def is_lower(self) -> bool:
        """Whether training did what it is for."""
        return self.last < self.first


def run_smoke_test(
    system: str, folder: Path, arrays: Arrays | None = None, plan_head: str = PLAN_HEADS[0]
) -> SmokeResult:
    """Train a system for STEPS steps on the CPU and compare its losses. arrays: made-up samples if None."""
    spec = SYSTEMS[system]
    given = build_synthetic_arrays(spec, SAMPLES, seed=0) if arrays is None else arrays
    data = {name: values[:SAMPLES] for name, values in given.items()}
    options = TrainingOptions(steps=STEPS, batch=BATCH, log_every=1, plan_head=plan_head)
    device = torch.device("cpu")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # on a busy machine, two threads that wait for each other take eight times as long
    try:
        Trainer(system, options, device).train(TrainingData(spec, data, device), np.ones(len(data["own"])), folder)
    finally:
        torch.set_num_threads(threads)
    losses = [value for _, name, value in read_curves(folder / "curves.csv") if name == "loss/total"]
    return SmokeResult(float(np.mean(losses[:COMPARED])), float(np.mean(losses[-COMPARED:])))
