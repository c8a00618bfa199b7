"""Exported networks are small, answer as PyTorch does, and fit the agents."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from mdrive_sumo.agents.learned.model_weights import load_network
from mdrive_sumo.agents.learned.network_inputs import describe_inputs
from mdrive_sumo.agents.learned.system_spec import PLAN_POINTS, SYSTEMS
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.evaluate_weights import evaluate_weights
from mdrive_sumo.learning.networks.build_network import build_network
from mdrive_sumo.learning.synthetic_samples import build_synthetic_arrays
from mdrive_sumo.learning.training import export_network as exporting
from mdrive_sumo.learning.training.checkpoint import Checkpoint
from mdrive_sumo.learning.training.export_network import MOST_BYTES, export_network


def make_checkpoint(system: str) -> Checkpoint:
    torch.manual_seed(0)
    weights = build_network(system).state_dict()
    return Checkpoint(system, 1, 1.0, {}, weights, {}, None, {"samples": 20})


@pytest.mark.parametrize("system", SYSTEMS)
def test_an_exported_network_drives(system: str, tmp_path: Path) -> None:
    spec = SYSTEMS[system]
    found = export_network(make_checkpoint(system), tmp_path)
    assert found.network.stat().st_size <= MOST_BYTES
    network = load_network(spec, found.network, use_gpu=False)  # checks inputs, outputs and the checksum
    assert network.manifest.training["samples"] == 20 and network.manifest.plan_head == "waypoints"
    shapes = describe_inputs(spec, network.manifest.memory_shape, has_limits=True)
    outputs = network.run({name: np.zeros(shape, dtype) for name, (shape, dtype) in shapes.items()})
    assert outputs["plan"].shape == (PLAN_POINTS, 2)
    arrays = build_synthetic_arrays(spec, 6, seed=0)
    metrics = evaluate_weights(spec, found.network, arrays)
    assert metrics["plan"]["ade_3s_m"] > 0 and metrics["constant_velocity"]["ade_3s_m"] < 1e-5
    assert metrics["samples"] == 6 and metrics["blackout"] != metrics["plan"]


def test_a_difference_from_pytorch_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exporting, "MOST_DIFFERENCE_M", 1e-12)
    with pytest.raises(InputError, match="expected plans within 1e-12 m of PyTorch's, found a difference of"):
        export_network(make_checkpoint("tcp"), tmp_path)


@pytest.mark.parametrize("row", [None, 1])
def test_answers_that_are_no_numbers_are_refused(
    row: int | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also if only the control, or only a later sample, is none: `max` passes over NaN."""
    checkpoint = make_checkpoint("tcp")
    if row is None:
        checkpoint.average["control.answer.2.bias"].fill_(float("nan"))
    else:
        compare, seen = exporting._compare, list[float]()

        def find_no_number(*arguments: Any) -> float:
            seen.append(compare(*arguments))
            return float("nan") if len(seen) == 1 + row else seen[-1]

        monkeypatch.setattr(exporting, "_compare", find_no_number)
    with pytest.raises(InputError, match=r"expected plans within 0\.01 m of PyTorch's, found a difference of nan m"):
        export_network(checkpoint, tmp_path)


def test_weights_of_another_network_are_refused(tmp_path: Path) -> None:
    checkpoint = make_checkpoint("tcp")
    del checkpoint.average["control.answer.2.bias"]
    with pytest.raises(InputError, match=r"expected weights of the network of this version .* Missing key"):
        export_network(checkpoint, tmp_path)


def test_a_large_file_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(exporting, "MOST_BYTES", 1000)
    with pytest.raises(InputError, match="expected at most 1000 bytes"):
        export_network(make_checkpoint("tcp"), tmp_path)
