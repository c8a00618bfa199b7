"""Validation: open-loop metrics of a network in training, on samples that it is not trained on."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch
from torch import nn

from mdrive_sumo.learning.plan_metrics import describe_plans, measure_controls, measure_plans
from mdrive_sumo.learning.training.plan_teacher import JUDGED, judge_plans
from mdrive_sumo.learning.training.predict_samples import predict_samples
from mdrive_sumo.learning.training.training_data import TrainingData

Arrays = Mapping[str, npt.NDArray[Any]]
JUDGED_AT_ONCE = 1024
"""Plans, to bound the memory."""
MOST_SAMPLES, MOST_GLANCED = 20_000, 1000
"""Samples of a full validation, and of one during training, evenly spread over the rows."""


@dataclass(frozen=True, slots=True)
class Validation:
    """Rows of `arrays` to validate on, and the same arrays on the device."""

    data: TrainingData
    arrays: Arrays
    rows: npt.NDArray[np.int64]

    def glance(self, network: nn.Module) -> dict[str, float]:
        """Return ADE and FDE over 3 s [m] on a few samples."""
        rows = _thin(self.rows, MOST_GLANCED)
        errors = measure_plans(predict_samples(network, self.data, rows).plans, self.arrays["expert_plan"][rows])
        return {f"validation/{name}": errors[name] for name in ("ade_3s_m", "fde_3s_m")}

    def describe(self, network: nn.Module) -> dict[str, Any]:
        """Return the metrics of a network, with and without images.

        `judged` compares heads: how many plans collide, leave the lane, ... unless the expert's does.
        """
        rows = _thin(self.rows, MOST_SAMPLES)
        seen = predict_samples(network, self.data, rows)
        blind = predict_samples(network, self.data, rows, blind=True)
        labels = {name: self.arrays[name][rows] for name in ("own", "expert_plan", "expert_control")}
        metrics = describe_plans(seen.plans, labels)
        metrics["judged"] = self._judge(seen.plans, rows)
        metrics["blackout"] = describe_plans(blind.plans, labels)["plan"]
        if seen.controls is not None:
            metrics["control_l1"] = measure_controls(seen.controls, labels["expert_control"])
        return metrics

    def _judge(self, plans: npt.NDArray[np.float32], rows: npt.NDArray[np.int64]) -> dict[str, float]:
        """Return the mean of each of the teacher's judgements, from 0 to 1, the expert's plans being 1."""
        total = np.zeros(len(JUDGED))
        for start in range(0, len(rows), JUDGED_AT_ONCE):
            part = slice(start, start + JUDGED_AT_ONCE)
            labels = self.data.take_labels(torch.from_numpy(rows[part]))
            judged = judge_plans(torch.from_numpy(plans[part]).to(self.data.device)[:, None], labels)
            total += judged[:, 0].double().sum(dim=0).cpu().numpy()
        return dict(zip(JUDGED, (total / len(rows)).tolist(), strict=True))


def _thin(rows: npt.NDArray[np.int64], most: int) -> npt.NDArray[np.int64]:
    return rows[:: max(1, -(-len(rows) // most))]
