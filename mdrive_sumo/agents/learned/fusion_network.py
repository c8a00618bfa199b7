"""FusionDetector: the two networks of a detector as they drive, and what goes into and comes out of them."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.box_decoding import DetectedBoxes, decode_boxes
from mdrive_sumo.agents.learned.fusion_spec import (
    BOX_NUMBERS,
    CLASSES,
    CODRIVING,
    FEATURE_CELLS,
    FEATURE_CHANNELS,
    FORECAST_S,
    GRID_CELLS,
    GRID_LAYERS,
    OUTPUT_CELLS,
    SHARING,
    check_detector,
)
from mdrive_sumo.agents.learned.model_weights import (
    WEIGHTS_FOLDER,
    DrivingNetwork,
    open_weights,
    read_checked_manifest,
)
from mdrive_sumo.agents.learned.point_grid import Cells, expand_cells

if TYPE_CHECKING:
    from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest

Float32 = npt.NDArray[np.float32]
_CELLS = [FEATURE_CELLS, FEATURE_CELLS]
ENCODER_INPUTS: Mapping[str, str] = MappingProxyType({"grid": f"float32 {[1, GRID_LAYERS, GRID_CELLS, GRID_CELLS]}"})
ENCODER_OUTPUTS: Mapping[str, str] = MappingProxyType(
    {"features": f"float32 {[1, FEATURE_CHANNELS, *_CELLS]}", "confidence": f"float32 {[1, *_CELLS]}"}
)
FUSION_OUTPUTS: Mapping[str, str] = MappingProxyType(
    {
        "scores": f"float32 {[len(CLASSES), OUTPUT_CELLS, OUTPUT_CELLS]}",
        "numbers": f"float32 {[BOX_NUMBERS, OUTPUT_CELLS, OUTPUT_CELLS]}",
    }
)
"""dtype and shape of each array."""
OCCUPANCY = f"float32 {[len(FORECAST_S), OUTPUT_CELLS, OUTPUT_CELLS]}"
"""dtype and shape of `tracks`, where known road users would go at constant velocity, and of `occupancy`."""


def describe_fusion_outputs(detector: str) -> Mapping[str, str]:
    """Return dtype and shape of each output of a detector's fusion."""
    return FUSION_OUTPUTS if detector != CODRIVING else {**FUSION_OUTPUTS, "occupancy": OCCUPANCY}


def describe_fusion_inputs(detector: str) -> Mapping[str, str]:
    """Return dtype and shape of each input of a detector's fusion; `none` and `early` know the own car only."""
    if detector not in SHARING:
        return {"features": f"float32 {[FEATURE_CHANNELS, *_CELLS]}"}
    return {
        "features": f"float32 {['cars', FEATURE_CHANNELS, *_CELLS]}",
        "arrived": f"float32 {['cars', *_CELLS]}",
        "pose": f"float32 {['cars', 3]}",
        "age": f"float32 {['cars']}",
        **({"tracks": OCCUPANCY} if detector == CODRIVING else {}),
    }


@dataclass(frozen=True, slots=True)
class EncodedScan:
    """What a car makes of its scan, for itself and for others."""

    features: Float32
    """(FEATURE_CHANNELS, FEATURE_CELLS, FEATURE_CELLS), none below 0."""
    confidence: Float32
    """(FEATURE_CELLS, FEATURE_CELLS) probability that the centre of a road user lies in a cell."""


@dataclass(frozen=True, slots=True)
class FusionDetector:
    """A loaded detector, without state."""

    name: str
    encoder: DrivingNetwork
    fusion: DrivingNetwork

    def encode(self, cells: Cells) -> EncodedScan:
        """Return the features of a scan; of `early` a scan is the merged cells of all cars."""
        found = self.encoder.run({"grid": expand_cells(cells)})
        return EncodedScan(found["features"], found["confidence"])

    def detect(
        self, features: Float32, arrived: Float32 | None = None, pose: Float32 | None = None, age: Float32 | None = None
    ) -> DetectedBoxes:
        """Return the boxes of a frame in the frame of the own car, which is car 0.

        features: (N, FEATURE_CHANNELS, FEATURE_CELLS, FEATURE_CELLS), each in its car's frame, 0 where nothing arrived.
        arrived: (N, FEATURE_CELLS, FEATURE_CELLS) 1 where a cell arrived, else 0. pose: (N, 3) x, y [m], yaw [rad] of
        each car in the own frame. age: (N,) [s]. `none` and `early` take the features of car 0 and nothing else.
        """
        if self.name in SHARING:
            assert arrived is not None and pose is not None and age is not None, "a fusion needs them"
            inputs = {"features": features, "arrived": arrived, "pose": pose, "age": age}
        else:
            inputs = {"features": features[0]}
        scores, numbers = self.fusion.session.run(list(FUSION_OUTPUTS), inputs)
        return decode_boxes(scores, numbers)

    def forecast(
        self, features: Float32, arrived: Float32, pose: Float32, age: Float32, tracks: Float32
    ) -> tuple[DetectedBoxes, Float32]:
        """Return the boxes of a frame, and how likely each cell is occupied at `FORECAST_S`; of `codriving` only.

        The first four arguments are those of `detect`. tracks: (len(FORECAST_S), OUTPUT_CELLS, OUTPUT_CELLS) 1 where a
        road user known from earlier scans would be at these times at constant velocity (`occupancy_grid`), else 0.
        """
        inputs = {"features": features, "arrived": arrived, "pose": pose, "age": age, "tracks": tracks}
        scores, numbers, occupancy = self.fusion.session.run([*FUSION_OUTPUTS, "occupancy"], inputs)
        return decode_boxes(scores, numbers), occupancy


def load_detector(name: str, folder: Path | None = None, use_gpu: bool = False) -> FusionDetector:
    """Return a detector. folder: holds NAME-encoder.onnx and NAME.onnx with their manifests; None: as packaged.

    Raises InputError with one sentence if the extra, a file or its match with the detector is missing.
    """
    check_detector(name)
    encoder, fusion = ((folder or WEIGHTS_FOLDER) / f"{part}.onnx" for part in (f"{name}-encoder", name))
    manifests = read_checked_manifest(encoder, f"{name}-encoder"), read_checked_manifest(fusion, name)
    return _open_detector(name, encoder, fusion, *manifests, use_gpu)


@lru_cache(maxsize=8)
def _open_detector(
    name: str,
    encoder: Path,
    fusion: Path,
    encoder_manifest: "WeightsManifest",
    fusion_manifest: "WeightsManifest",
    use_gpu: bool,
) -> FusionDetector:
    """Return a detector; manifests are part of the key, so new weights under an old name are loaded anew."""
    return FusionDetector(
        name,
        open_weights(encoder, encoder_manifest, ENCODER_INPUTS, ENCODER_OUTPUTS, use_gpu),
        open_weights(fusion, fusion_manifest, describe_fusion_inputs(name), describe_fusion_outputs(name), use_gpu),
    )
