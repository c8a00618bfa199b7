"""predict_samples: what a network in training answers to samples, with the memory that it would have had."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.plan_anchors import decode_plans
from mdrive_sumo.learning.networks.bev_grid import compute_cell_centres
from mdrive_sumo.learning.networks.bev_memory import halve_motion, warp_memory
from mdrive_sumo.learning.training.training_data import TrainingData, build_empty_memory


def recall_previous(
    network: nn.Module, inputs: dict[str, Tensor], motion: Tensor, is_there: Tensor
) -> dict[str, Tensor]:
    """Return `memory` (batch, *MEMORY_SHAPE) and `motion` (batch, 3) for the present decision.

    inputs: images two decisions ago. motion: since then; it is halved, and the memory moved by the first half, as the
    decision between would have done. The newest slot is left empty: a network hands it on and does not look at it.
    is_there: (batch,) false where nothing is remembered.
    """
    with torch.no_grad():
        seen = network.encode(inputs)
        half = halve_motion(motion)
        centres = torch.from_numpy(compute_cell_centres()).to(motion.device, torch.float32)
        older = warp_memory(seen[:, None], half, centres)
        memory = torch.cat((torch.zeros_like(older), older), dim=1) * is_there[:, None, None, None, None]
    return {"memory": memory, "motion": half}


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
        plans.append(_take_plans(answer))
        if "control" in answer:
            controls.append(answer["control"].float().cpu())
    return Predictions(torch.cat(plans).numpy(), torch.cat(controls).numpy() if controls else None)


def _take_plans(answer: dict[str, Tensor]) -> Tensor:
    """Return the plans (batch, PLAN_POINTS, 2) [m], decided by anchors as a car's are."""
    if "anchor_scores" not in answer:
        return answer["plan"].float().cpu()
    scores, offsets = (answer[name].float().cpu().numpy() for name in ("anchor_scores", "anchor_offsets"))
    return torch.from_numpy(decode_plans(scores, offsets).astype(np.float32))


def _take_inputs(network: nn.Module, data: TrainingData, rows: Tensor, blind: bool) -> dict[str, Tensor]:
    inputs = data.take_inputs(rows)
    if blind:
        inputs |= {image.name: torch.zeros_like(inputs[image.name]) for image in data.spec.images}
    if data.spec.uses_memory and blind:
        inputs |= build_empty_memory(len(rows), data.device)
    elif data.spec.uses_memory:
        inputs |= recall_previous(network, *data.take_previous(rows))
    return inputs
