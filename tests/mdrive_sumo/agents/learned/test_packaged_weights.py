"""The weights in the wheel: which files there are, how large they are, and that each network answers."""

import numpy as np
import pytest

from mdrive_sumo.agents.learned.fusion_network import load_detector
from mdrive_sumo.agents.learned.fusion_spec import (
    CODRIVING,
    FEATURE_CELLS,
    FEATURE_CHANNELS,
    FORECAST_S,
    MAX_CAVS,
    OUTPUT_CELLS,
    SHARING,
    TRAINED,
)
from mdrive_sumo.agents.learned.model_weights import WEIGHTS_FOLDER, load_network
from mdrive_sumo.agents.learned.network_inputs import Inputs, describe_inputs
from mdrive_sumo.agents.learned.point_grid import build_point_cells
from mdrive_sumo.agents.learned.system_spec import SYSTEMS

MOST_SYSTEM_BYTES = 3_000_000
MOST_DETECTOR_BYTES = 2_000_000
"""Of both networks of a detector."""
MOST_BYTES = 30_000_000
"""Of all weights in the wheel."""
LEAST_SAMPLES, LEAST_FRAMES, LEAST_STEPS = 10_000, 5_000, 1_000
"""What a training that counts has seen: less is a try."""


def test_the_wheel_has_these_weights_and_no_others() -> None:
    names = (*SYSTEMS, *(part for name in TRAINED for part in (name, f"{name}-encoder")))
    expected = {f"{name}.{ending}" for name in names for ending in ("onnx", "json")}
    files = {path.name: path.stat().st_size for path in WEIGHTS_FOLDER.iterdir()}
    assert {*files} == expected
    assert sum(files.values()) <= MOST_BYTES


@pytest.mark.parametrize("name", SYSTEMS)
def test_a_system_is_small_and_answers(name: str) -> None:
    network = load_network(SYSTEMS[name], use_gpu=False)
    manifest = network.manifest
    assert manifest.bytes == (WEIGHTS_FOLDER / f"{name}.onnx").stat().st_size <= MOST_SYSTEM_BYTES
    assert count(manifest.training, "samples") >= LEAST_SAMPLES and count(manifest.training, "steps") >= LEAST_STEPS
    shapes = describe_inputs(SYSTEMS[name], manifest.memory_shape, has_limits=manifest.has_limits)
    inputs: Inputs = {array: np.zeros(shape, kind) for array, (shape, kind) in shapes.items()}
    plan = network.run(inputs)["plan"]
    assert plan.shape == (6, 2) and np.isfinite(plan).all()


@pytest.mark.parametrize("name", TRAINED)
def test_a_detector_is_small_and_answers(name: str) -> None:
    """Of a wall of points, alone and with four senders of the same scan."""
    detector = load_detector(name)
    networks = detector.encoder, detector.fusion
    assert sum(network.manifest.bytes for network in networks) <= MOST_DETECTOR_BYTES
    for network in networks:
        training = network.manifest.training
        assert count(training, "frames") >= LEAST_FRAMES and count(training, "steps") >= LEAST_STEPS
    points = np.column_stack((np.full(200, 12.0), np.linspace(-5.0, 5.0, 200), np.full(200, -1.0)))
    scan = detector.encode(build_point_cells(points.astype(np.float32)))
    assert scan.features.shape == (FEATURE_CHANNELS, FEATURE_CELLS, FEATURE_CELLS)
    assert np.isfinite(scan.features).all() and 0.0 <= scan.confidence.min() <= scan.confidence.max() <= 1.0
    for cars in (1, MAX_CAVS) if name in SHARING else (1,):
        maps = np.repeat(scan.features[None], cars, axis=0)
        arrived = np.ones((cars, FEATURE_CELLS, FEATURE_CELLS), np.float32)
        shared = arrived, np.zeros((cars, 3), np.float32), np.zeros(cars, np.float32)
        if name == CODRIVING:
            shape = len(FORECAST_S), OUTPUT_CELLS, OUTPUT_CELLS
            boxes, occupancy = detector.forecast(maps, *shared, np.zeros(shape, np.float32))
            assert occupancy.shape == shape and 0.0 <= occupancy.min() <= occupancy.max() <= 1.0
        else:
            boxes = detector.detect(maps, *shared)
        assert np.isfinite(boxes.boxes).all() and len(boxes.boxes) == len(boxes.scores)


def count(training: object, name: str) -> int:
    """A number of a manifest's summary; 0 where it is missing."""
    found = training.get(name) if isinstance(training, dict) else None
    return found if isinstance(found, int) else 0
