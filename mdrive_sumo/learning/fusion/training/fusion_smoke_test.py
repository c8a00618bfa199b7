"""run_fusion_smoke_test: a detector learns made-up frames by heart, on any machine."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from mdrive_sumo.learning.fusion.average_precision import compute_precision
from mdrive_sumo.learning.fusion.conditions import CONDITIONS
from mdrive_sumo.learning.fusion.networks.fusion_network import FusionNetwork
from mdrive_sumo.learning.fusion.synthetic_frames import build_synthetic_frames
from mdrive_sumo.learning.fusion.training.detect_frames import detect_frames
from mdrive_sumo.learning.fusion.training.frame_store import FrameStore
from mdrive_sumo.learning.fusion.training.fusion_trainer import FusionTrainer
from mdrive_sumo.learning.training.training_curves import read_curves
from mdrive_sumo.learning.training.training_options import TrainingOptions

STEPS, FRAMES, BOXES = 150, 2, 6
"""Size of a run that takes half a minute on one core."""
COMPARED = 10
"""Steps at the beginning and at the end whose mean losses are compared."""
LEAST_PRECISION = 0.8


@dataclass(frozen=True, slots=True)
class FusionSmokeResult:
    """Mean total loss of the first and of the last COMPARED steps, and what is found afterwards."""

    first: float
    last: float
    precision: float
    """Average precision of vehicles at an intersection over union of 0.5, on the frames of the training."""

    @property
    def has_learned(self) -> bool:
        """Whether training did what it is for."""
        return self.last < self.first and self.precision >= LEAST_PRECISION


def run_fusion_smoke_test(detector: str, folder: Path, is_gated: bool = True) -> FusionSmokeResult:
    """Train a detector for STEPS steps on the CPU on frames in which every car sees every box.

    `disconet` gets a fresh teacher. The folder gets checkpoint, weights and curves. Raises InputError.
    """
    frames = build_synthetic_frames(FRAMES, 0, boxes=BOXES, hidden_share=0.0)
    options = TrainingOptions(steps=STEPS, batch=1, learning_rate=4e-3, log_every=1, average_decay=0.9)
    device = torch.device("cpu")
    threads = torch.get_num_threads()
    torch.set_num_threads(1)  # on a busy machine, two threads that wait for each other take eight times as long
    try:
        teacher = FusionNetwork("early") if detector == "disconet" else None
        trainer = FusionTrainer(detector, options, device, is_gated=is_gated, teacher=teacher)
        store = FrameStore(frames, device)
        trainer.train(store, np.ones(len(frames)), folder)
        network = trainer.average.network
        assert isinstance(network, FusionNetwork)
        trainer.settle(network, store)
        trainer.save(folder)
        found = detect_frames(network, frames, store, CONDITIONS[0])
    finally:
        torch.set_num_threads(threads)
    losses = [value for _, name, value in read_curves(folder / "curves.csv") if name == "loss/total"]
    precision = compute_precision(frames, found, 0.5)
    return FusionSmokeResult(float(np.mean(losses[:COMPARED])), float(np.mean(losses[-COMPARED:])), precision)
