"""evaluate_weights: open-loop metrics of exported weights, run as they drive, with memory from decision to decision."""

import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.model_weights import DrivingNetwork, load_network
from mdrive_sumo.agents.learned.network_inputs import Inputs, black_out_images, compute_motion, describe_inputs
from mdrive_sumo.agents.learned.system_spec import SystemSpec
from mdrive_sumo.learning.plan_metrics import describe_plans, measure_controls

Arrays = Mapping[str, npt.NDArray[Any]]


def evaluate_weights(spec: SystemSpec, path: Path | None, arrays: Arrays) -> dict[str, Any]:
    """Return metrics of weights (.onnx; None: as packaged) on all samples of `arrays`, with and without images.

    Raises InputError for weights that do not fit.
    """
    network = load_network(spec, path, use_gpu=False)
    plans, controls, seconds = _predict(network, spec, arrays, is_blind=False)
    blind, _, _ = _predict(network, spec, arrays, is_blind=True)
    metrics = describe_plans(plans, arrays)
    metrics["blackout"] = describe_plans(blind, arrays)["plan"]
    metrics["decision_ms"] = {"median": 1e3 * float(np.median(seconds)), "p99": 1e3 * float(np.quantile(seconds, 0.99))}
    if spec.answers_control:
        metrics["control_l1"] = measure_controls(controls, arrays["expert_control"])
    return {"system": spec.name, "sha256": network.manifest.sha256, **metrics}


def _predict(
    network: DrivingNetwork, spec: SystemSpec, arrays: Arrays, *, is_blind: bool
) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.float32], npt.NDArray[np.float64]]:
    """Return plans (M, n, 2), controls (M, 3) and the seconds (M,) that each decision took."""
    memory_shape = network.manifest.memory_shape
    described = describe_inputs(spec, memory_shape, has_limits=network.manifest.has_limits)
    names = [name for name in described if name not in ("memory", "motion")]
    count = len(arrays["own"])
    plans = np.zeros_like(arrays["expert_plan"])
    controls, seconds = np.zeros((count, 3), np.float32), np.zeros(count)
    memory: npt.NDArray[np.float32] | None = None
    for row in range(count):
        inputs: Inputs = {name: arrays[name][row] for name in names}
        if is_blind:
            inputs = black_out_images(spec, inputs)
        if spec.uses_memory:
            is_next = row > 0 and memory is not None and arrays["episode"][row] == arrays["episode"][row - 1]
            inputs["memory"] = memory if is_next and memory is not None else np.zeros(memory_shape, np.float32)
            poses = arrays["own"][[row - 1 if is_next else row, row], :3].astype(np.float64)
            inputs["motion"] = compute_motion(poses[0], poses[1])
        began = time.perf_counter()
        outputs = network.run(inputs)
        seconds[row] = time.perf_counter() - began
        plans[row] = outputs["plan"]
        controls[row] = outputs.get("control", controls[row])
        memory = outputs.get("bev")
    return plans, controls, seconds
