"""Open-loop metrics of a network: how far its plans lie from the expert's, against driving on at constant velocity."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.system_spec import PLAN_INTERVAL_S, PLAN_POINTS
from mdrive_sumo.learning.training.recall import recall_previous
from mdrive_sumo.learning.training.training_data import TrainingData, build_empty_memory

HORIZONS_S = (1.0, 2.0, 3.0)
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
    """Return the answers of a network to samples, with memory as in training. blind: all images are black."""
    network.eval()
    plans: list[Tensor] = []
    controls: list[Tensor] = []
    for start in range(0, len(rows), batch):
        chosen = torch.from_numpy(rows[start : start + batch])
        with torch.autocast(data.device.type, torch.bfloat16, enabled=data.device.type == "cuda"):
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


def predict_constant_velocity(own: Float) -> Float:
    """Return plans (M, PLAN_POINTS, 2) straight ahead at the present speed of states (M, 6)."""
    times = PLAN_INTERVAL_S * np.arange(1, PLAN_POINTS + 1, dtype=np.float32)
    ahead = own[:, 3, None] * times
    return np.stack((ahead, np.zeros_like(ahead)), axis=-1)


def measure_plans(plans: Float, expert: Float) -> dict[str, float]:
    """Return ADE and FDE [m] at HORIZONS_S of plans against the expert's, both (M, PLAN_POINTS, 2)."""
    gap = plans.astype(np.float64) - expert
    error = np.sqrt((gap * gap).sum(axis=-1))
    found: dict[str, float] = {}
    for horizon in HORIZONS_S:
        points = round(horizon / PLAN_INTERVAL_S)
        found[f"ade_{horizon:.0f}s_m"] = float(error[:, :points].mean())
        found[f"fde_{horizon:.0f}s_m"] = float(error[:, points - 1].mean())
    return found


def measure_by_kind(plans: Float, expert: Float, kinds: npt.NDArray[np.str_]) -> dict[str, dict[str, float]]:
    """Return the number of samples and the ADE over 3 s [m] for each kind of sample."""
    found: dict[str, dict[str, float]] = {}
    for kind in sorted(set(kinds.tolist())):
        rows = kinds == kind
        found[kind] = {"samples": int(rows.sum()), "ade_3s_m": measure_plans(plans[rows], expert[rows])["ade_3s_m"]}
    return found


def measure_controls(controls: Float, expert: Float) -> Mapping[str, float]:
    """Return the mean L1 distances of throttle, brake and steer (M, 3)."""
    gap = np.abs(controls.astype(np.float64) - expert).mean(axis=0)
    return dict(zip(("throttle", "brake", "steer"), gap.tolist(), strict=True))
