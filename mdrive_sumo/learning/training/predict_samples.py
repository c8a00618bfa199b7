"""predict_samples: what a network in training answers to samples."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from mdrive_sumo.learning.training.recall import recall_previous
from mdrive_sumo.learning.training.training_data import TrainingData, build_empty_memory

Float = npt.NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Predictions:
    """What a network answers to samples: plans (M, PLAN_POINTS, 2) [m, ego frame], controls (M, 3) or None."""

    plans: Float
    controls: Float | None


@torch.no_grad()
def predict_samples(
    network: nn.Module, data: TrainingData, rows: npt.NDArray[np.int64], batch: int = 128, *, blind: bool = False
) -> Predictions:
    """Return the answers of a network to samples, in single precision, with memory as in training.

    blind: all images are black.
    """
    network.eval()
    plans: list[Tensor] = []
    controls: list[Tensor] = []
    for start in range(0, len(rows), batch):
        chosen = torch.from_numpy(rows[start : start + batch])
        answer = network(_take_inputs(network, data, chosen, blind))
        plans.append(answer["plan"].float().cpu())
        if "control" in answer:
            controls.append(answer["control"].float().cpu())
    return Predictions(torch.cat(plans).numpy(), torch.cat(controls).numpy() if controls else None)


def _take_inputs(network: nn.Module, data: TrainingData, rows: Tensor, blind: bool) -> dict[str, Tensor]:
    inputs = data.take_inputs(rows)
    if blind:
        inputs |= {image.name: torch.zeros_like(inputs[image.name]) for image in data.spec.images}
    if data.spec.uses_memory and blind:
        inputs |= build_empty_memory(len(rows), data.device)
    elif data.spec.uses_memory:
        inputs |= recall_previous(network, *data.take_previous(rows))
    return inputs
