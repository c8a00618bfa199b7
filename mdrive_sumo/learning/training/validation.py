"""Validation: open-loop metrics of a network in training, on samples that it is not trained on."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
from torch import nn

from mdrive_sumo.learning.plan_metrics import describe_plans, measure_controls, measure_plans
from mdrive_sumo.learning.training.predict_samples import predict_samples
from mdrive_sumo.learning.training.training_data import TrainingData

Arrays = Mapping[str, npt.NDArray[Any]]
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
        """Return the metrics of a network, with and without images."""
        rows = _thin(self.rows, MOST_SAMPLES)
        seen = predict_samples(network, self.data, rows)
        blind = predict_samples(network, self.data, rows, blind=True)
        labels = {name: self.arrays[name][rows] for name in ("own", "expert_plan", "expert_control")}
        metrics = describe_plans(seen.plans, labels)
        metrics["blackout"] = describe_plans(blind.plans, labels)["plan"]
        if seen.controls is not None:
            metrics["control_l1"] = measure_controls(seen.controls, labels["expert_control"])
        return metrics


def _thin(rows: npt.NDArray[np.int64], most: int) -> npt.NDArray[np.int64]:
    return rows[:: max(1, -(-len(rows) // most))]
