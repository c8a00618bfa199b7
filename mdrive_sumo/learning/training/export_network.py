"""export_network: a trained network as ONNX with half-precision weights, checked against PyTorch."""

import copy
import hashlib
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import onnx
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from mdrive_sumo.agents.learned.network_inputs import describe_inputs, describe_outputs
from mdrive_sumo.agents.learned.plan_anchors import build_anchors
from mdrive_sumo.agents.learned.system_spec import SYSTEMS, SystemSpec
from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.onnx_manifest import write_manifest
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.learning.networks.build_network import build_network, count_parameters
from mdrive_sumo.learning.synthetic_samples import build_synthetic_arrays
from mdrive_sumo.learning.training.checkpoint import Checkpoint, take_weights
from mdrive_sumo.learning.training.training_data import build_empty_memory

OPSET = 17
MOST_BYTES = 3_000_000
"""Bytes of a file of weights: they are part of the package."""
LEAST_SHARED = 64
"""Constants with fewer numbers stay in single precision."""
MOST_DIFFERENCE_M = 1e-2
"""[m] Between plans of the exported network and of PyTorch's, with the same half-precision weights; also of control."""
CHECKED_SAMPLES, CHECKED_REAL_SAMPLES = 4, 20


class _Positional(nn.Module):
    """The network with positional inputs and outputs, as exporters want it."""

    def __init__(self, network: nn.Module, inputs: list[str], outputs: list[str]) -> None:
        super().__init__()
        self.network = network
        self.inputs = inputs
        self.outputs = outputs

    def forward(self, *values: Tensor) -> tuple[Tensor, ...]:
        answer = self.network(dict(zip(self.inputs, values, strict=True)))
        return tuple(answer[name] for name in self.outputs)


Arrays = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True, slots=True)
class ExportedNetwork:
    """The two files, and the largest differences [m] of plan (or scores and offsets) and control from PyTorch's."""

    network: Path
    manifest: Path
    difference: float
    """With the rounded weights of the file."""
    rounding: float
    """With the weights of the checkpoint."""


def export_network(checkpoint: Checkpoint, folder: Path, arrays: Arrays | None = None) -> ExportedNetwork:
    """Write DIR/SYSTEM.onnx and DIR/SYSTEM.json from a checkpoint's best weights.

    arrays: samples of a data set to compare answers on, beside made-up ones.
    Raises InputError if the file is too large or answers otherwise than PyTorch.
    """
    spec = SYSTEMS[checkpoint.system]
    network = build_network(checkpoint.system, checkpoint.plan_head)
    take_weights(network, checkpoint.chosen, checkpoint.system)
    network.eval()
    halved = halve_weights(network)
    make_folder(folder)
    path = folder / f"{checkpoint.system}.onnx"
    samples = [_take_sample(spec, build_synthetic_arrays(spec, 1, seed=i), 0) for i in range(CHECKED_SAMPLES)]
    if arrays is not None:
        rows = np.linspace(0, len(arrays["own"]) - 1, CHECKED_REAL_SAMPLES).astype(int)
        samples += [_take_sample(spec, arrays, row) for row in rows.tolist()]
    inputs, outputs = list(samples[0]), list(describe_outputs(spec, plan_head=checkpoint.plan_head))
    write_onnx(_Positional(halved, inputs, outputs).eval(), samples[0], outputs, path)
    file = OnnxFile(path)
    difference = find_largest(_compare(halved, file, sample) for sample in samples)
    rounding = find_largest(_compare(network, file, sample) for sample in samples)
    _check(path, difference)
    manifest = _build_manifest(checkpoint, path, network, samples[0])
    write_manifest(manifest, path.with_suffix(".json"))
    return ExportedNetwork(path, path.with_suffix(".json"), difference, rounding)


def halve_weights(network: nn.Module) -> nn.Module:
    """Return a copy with all numbers rounded to half precision, as the file holds them; it computes in single.

    Normalisation is folded into the convolutions first, as the exporter would do after rounding.
    """
    halved = copy.deepcopy(network)
    for module in halved.modules():
        if isinstance(module, nn.Sequential):
            _fold_normalisation(module)
    for each in (*halved.parameters(), *halved.buffers()):
        if each.is_floating_point():
            each.data = each.data.half().float()
    return halved


def _fold_normalisation(layers: nn.Sequential) -> None:
    for i in range(len(layers) - 1):
        convolution, normalisation = layers[i], layers[i + 1]
        if isinstance(convolution, nn.Conv2d) and isinstance(normalisation, nn.BatchNorm2d):
            layers[i], layers[i + 1] = fuse_conv_bn_eval(convolution, normalisation), nn.Identity()


def _take_sample(spec: SystemSpec, arrays: Arrays, row: int) -> dict[str, Tensor]:
    """Return the inputs of a sample in the network's order, with a batch of one; memory is made up."""
    generator = torch.Generator().manual_seed(row)
    empty = build_empty_memory(1, torch.device("cpu"))
    return {
        name: torch.rand(empty[name].shape, generator=generator)
        if name in empty
        else torch.from_numpy(arrays[name][row : row + 1])
        for name in describe_inputs(spec, has_limits=True)
    }


def write_onnx(
    network: nn.Module,
    sample: Mapping[str, Tensor],
    outputs: list[str],
    path: Path,
    any_length: Mapping[str, Mapping[int, str]] | None = None,
    is_halved: bool = True,
) -> None:
    """Write a network with positional inputs as ONNX, its constants in half precision unless told otherwise.

    sample: an input of each name, in order. any_length: names of the axes of arrays that may have any length.
    """
    with warnings.catch_warnings():
        # The exporter that needs nothing but `onnx` is the older one, and says so; tracing tells of constant shapes.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            network, tuple(sample.values()), str(path), dynamo=False, opset_version=OPSET,
            input_names=list(sample), output_names=outputs, dynamic_axes=any_length,
        )  # fmt: skip
    model = onnx.load(str(path))
    if is_halved:
        store_half(model)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def store_half(model: onnx.ModelProto) -> None:
    """Store constants in half precision, each cast to single where it is used: a runtime does so once, as it starts."""
    casts: list[onnx.NodeProto] = []
    for constant in model.graph.initializer:
        values = numpy_helper.to_array(constant)
        if values.dtype != np.float32 or values.size < LEAST_SHARED:
            continue
        name = constant.name
        constant.CopyFrom(numpy_helper.from_array(values.astype(np.float16), f"{name}.half"))
        casts.append(helper.make_node("Cast", [f"{name}.half"], [name], to=TensorProto.FLOAT))
    for node in reversed(casts):
        model.graph.node.insert(0, node)


class OnnxFile:
    """An exported network, by onnxruntime on one core."""

    def __init__(self, path: Path) -> None:
        """A session takes as long to make as five answers (cProfile of an export of `tcp` and `vad`)."""
        import onnxruntime  # here: only the check of an export needs it

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = options.inter_op_num_threads = 1
        self._session = onnxruntime.InferenceSession(str(path), options, providers=["CPUExecutionProvider"])
        self._names = [output.name for output in self._session.get_outputs()]

    def run(self, inputs: Mapping[str, Tensor]) -> dict[str, npt.NDArray[np.float32]]:
        """Return the outputs by name."""
        found = self._session.run(self._names, {name: each.numpy() for name, each in inputs.items()})
        return {name: np.asarray(each) for name, each in zip(self._names, found, strict=True)}


def _compare(network: nn.Module, file: OnnxFile, sample: Mapping[str, Tensor]) -> float:
    """Return the largest difference of plan, scores and control between the file and the network."""
    with torch.no_grad():
        expected = network(dict(sample))
    found = file.run(sample)
    pairs = [(found[name], each.numpy()) for name, each in expected.items() if name != "bev"]
    return find_largest(float(np.abs(one - other).max()) for one, other in pairs)


def find_largest(differences: Iterable[float]) -> float:
    """Return the largest number; NaN if one is none, which `max` would pass over."""
    return float(np.max(list(differences)))


def _check(path: Path, difference: float) -> None:
    if not difference <= MOST_DIFFERENCE_M:
        raise InputError(
            f"{path}: expected plans within {MOST_DIFFERENCE_M} m of PyTorch's, found a difference of"
            f" {difference:.3g} m"
        )
    size = path.stat().st_size
    if size > MOST_BYTES:
        raise InputError(f"{path}: expected at most {MOST_BYTES} bytes, found {size}: make the network smaller")


def _build_manifest(
    checkpoint: Checkpoint, path: Path, network: nn.Module, sample: Mapping[str, Tensor]
) -> WeightsManifest:
    content = read_bytes(path)
    return WeightsManifest(
        system=checkpoint.system,
        sha256=hashlib.sha256(content).hexdigest(),
        bytes=len(content),
        parameters=count_parameters(network),
        memory_shape=tuple(sample["memory"].shape[1:]) if "memory" in sample else (),
        has_limits=True,
        plan_head=checkpoint.plan_head,
        anchors=build_anchors().digest if checkpoint.plan_head == "anchors" else "",
        training=checkpoint.summary,
    )
