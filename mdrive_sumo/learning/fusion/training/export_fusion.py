"""export_fusion: a trained detector as two ONNX files, which a sender and a receiver need, checked against PyTorch."""

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor, nn

from mdrive_sumo.agents.learned.fusion_network import ENCODER_OUTPUTS, describe_fusion_outputs
from mdrive_sumo.agents.learned.fusion_spec import (
    CODRIVING,
    FEATURE_CELLS,
    FEATURE_CHANNELS,
    FORECAST_S,
    GRID_CELLS,
    GRID_LAYERS,
    MAX_CAVS,
    OUTPUT_CELLS,
    SHARING,
    TILE_CELLS,
    TILE_ROWS,
)
from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.onnx_manifest import write_manifest
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.learning.fusion.networks.detection_head import compute_scores
from mdrive_sumo.learning.fusion.networks.fusion_network import FusionNetwork
from mdrive_sumo.learning.networks.build_network import count_parameters
from mdrive_sumo.learning.training.checkpoint import Checkpoint, take_weights
from mdrive_sumo.learning.training.export_network import OnnxFile, find_largest, halve_weights, write_onnx

MAX_FILES_BYTES = 2_000_000
"""Of both files together: they are part of the package."""
MAX_DIFFERENCE = 1e-3
"""Between answers of the files and of PyTorch with the same half-precision weights: of scores and features, and [m] of
boxes. Both compute in single precision, in other orders."""
CHECKED_CARS = (1, 2, MAX_CAVS)
"""Numbers of cars that the answers are compared with."""


class _EncoderAnswer(nn.Module):
    """The encoder with the confidence as a probability."""

    def __init__(self, network: FusionNetwork) -> None:
        super().__init__()
        self.encoder = network.encoder

    def forward(self, grid: Tensor) -> tuple[Tensor, Tensor]:
        features, confidence = self.encoder(grid)
        return features, torch.sigmoid(confidence)


class _FusionAnswer(nn.Module):
    """Fusion and head of one frame, without the dimension of frames."""

    def __init__(self, network: FusionNetwork) -> None:
        super().__init__()
        self.network = network

    def forward(self, features: Tensor, arrived: Tensor, pose: Tensor, age: Tensor) -> tuple[Tensor, Tensor]:
        answer = self.network(features[None], arrived[None], pose[None], age[None])
        return answer.scores[0], answer.numbers[0]


class _ForecastAnswer(nn.Module):
    """Fusion, head and forecast of one frame."""

    def __init__(self, network: FusionNetwork) -> None:
        super().__init__()
        assert network.forecast is not None, "of codriving only"
        self.network, self.forecast = network, network.forecast

    def forward(
        self, features: Tensor, arrived: Tensor, pose: Tensor, age: Tensor, tracks: Tensor
    ) -> tuple[Tensor, Tensor, Tensor]:
        answer = self.network(features[None], arrived[None], pose[None], age[None])
        occupancy = torch.sigmoid(self.forecast(answer.fused, tracks[None]))
        return answer.scores[0], answer.numbers[0], occupancy[0]


class _HeadAnswer(nn.Module):
    """The head of a detector without fusion, on the own car's features."""

    def __init__(self, network: FusionNetwork) -> None:
        super().__init__()
        self.head = network.head

    def forward(self, features: Tensor) -> tuple[Tensor, Tensor]:
        heat, numbers, fit = self.head(features[None])
        return compute_scores(heat, fit)[0], numbers[0]


@dataclass(frozen=True, slots=True)
class ExportedDetector:
    """The files, and the largest differences of their answers from PyTorch's."""

    encoder: Path
    fusion: Path
    difference: float
    """With the rounded weights of the files."""
    rounding: float
    """With the weights of the checkpoint."""

    @property
    def bytes(self) -> int:
        """Size of both networks."""
        return self.encoder.stat().st_size + self.fusion.stat().st_size


def build_trained_network(checkpoint: Checkpoint) -> FusionNetwork:
    """Return the network of a checkpoint with its averaged weights, for evaluation. Raises InputError."""
    network = FusionNetwork(checkpoint.system, bool(checkpoint.summary.get("is_gated")))
    take_weights(network, checkpoint.average, checkpoint.system)
    return network.eval()


def export_fusion(checkpoint: Checkpoint, folder: Path) -> ExportedDetector:
    """Write DIR/NAME-encoder.onnx and DIR/NAME.onnx, each with its manifest, from a checkpoint's averaged weights.

    Raises InputError if the files are too large or answer otherwise than PyTorch.
    """
    network = build_trained_network(checkpoint)
    halved = halve_weights(network)
    make_folder(folder)
    encoder, fusion = folder / f"{network.detector}-encoder.onnx", folder / f"{network.detector}.onnx"
    is_fusion = network.detector in SHARING
    wrap = _ForecastAnswer if network.forecast is not None else _FusionAnswer if is_fusion else _HeadAnswer
    grid = _make_grid()
    frames = [_make_frame(cars, network.detector) for cars in (CHECKED_CARS if is_fusion else (1,))]
    write_onnx(_EncoderAnswer(halved).eval(), grid, list(ENCODER_OUTPUTS), encoder)
    any_length = {name: {0: "cars"} for name in frames[-1] if name != "tracks"} if is_fusion else None
    write_onnx(wrap(halved).eval(), frames[-1], list(describe_fusion_outputs(network.detector)), fusion, any_length)
    encodes, fuses = OnnxFile(encoder), OnnxFile(fusion)
    difference, rounding = (
        find_largest(
            (_compare(_EncoderAnswer(one), encodes, grid), *(_compare(wrap(one), fuses, frame) for frame in frames))
        )
        for one in (halved, network)
    )
    exported = ExportedDetector(encoder, fusion, difference, rounding)
    _check(exported)
    encoder_size = count_parameters(network.encoder)
    for path, size in ((encoder, encoder_size), (fusion, count_parameters(network) - encoder_size)):
        write_manifest(_describe_file(path, size, checkpoint), path.with_suffix(".json"))
    return exported


def _make_grid() -> dict[str, Tensor]:
    """Return a made-up scan, a tenth of whose cells are occupied."""
    random = torch.Generator().manual_seed(0)
    shape = 1, GRID_LAYERS, GRID_CELLS, GRID_CELLS
    counts = torch.randint(1, 20, shape, generator=random)
    return {"grid": torch.log1p(counts * (torch.rand(shape, generator=random) < 0.1))}


def _make_frame(cars: int, detector: str) -> dict[str, Tensor]:
    """Return made-up inputs of a fusion, in order; a fifth of the senders' tiles did not arrive."""
    random = torch.Generator().manual_seed(cars)
    features = torch.rand((cars, FEATURE_CHANNELS, FEATURE_CELLS, FEATURE_CELLS), generator=random)
    if detector not in SHARING:
        return {"features": features[0]}
    tiles = (torch.rand((cars, TILE_ROWS, TILE_ROWS), generator=random) < 0.8).float()
    arrived = tiles.repeat_interleave(TILE_CELLS, 1).repeat_interleave(TILE_CELLS, 2)
    pose = torch.randn((cars, 3), generator=random) * torch.tensor((20.0, 20.0, 1.0))
    arrived[0], pose[0] = 1.0, 0.0
    age = 0.1 * torch.arange(cars)
    frame = {"features": features * arrived[:, None], "arrived": arrived, "pose": pose, "age": age}
    if detector == CODRIVING:
        shape = len(FORECAST_S), OUTPUT_CELLS, OUTPUT_CELLS
        frame["tracks"] = (torch.rand(shape, generator=random) < 0.02).float()
    return frame


def _compare(network: nn.Module, file: OnnxFile, inputs: Mapping[str, Tensor]) -> float:
    """Return the largest difference between the answers of a file and of a network."""
    with torch.no_grad():
        expected = network.eval()(*inputs.values())
    found = file.run(inputs)
    return find_largest(
        float(np.abs(one - other.numpy()).max()) for one, other in zip(found.values(), expected, strict=True)
    )


def _check(exported: ExportedDetector) -> None:
    if not exported.difference <= MAX_DIFFERENCE:
        raise InputError(
            f"{exported.fusion}: expected answers within {MAX_DIFFERENCE} of PyTorch's, found a difference of"
            f" {exported.difference:.3g}"
        )
    if exported.bytes > MAX_FILES_BYTES:
        raise InputError(
            f"{exported.fusion}: expected at most {MAX_FILES_BYTES} bytes with its encoder, found {exported.bytes}:"
            " make the network smaller"
        )


def _describe_file(path: Path, parameters: int, checkpoint: Checkpoint) -> WeightsManifest:
    content = read_bytes(path)
    return WeightsManifest(
        system=path.stem,
        sha256=hashlib.sha256(content).hexdigest(),
        bytes=len(content),
        parameters=parameters,
        training=checkpoint.summary,
    )
