"""Detectors made by hand: what has points as high as a car and none as high as a wall is a car. No tests in here."""

import hashlib
from pathlib import Path

import numpy as np

from mdrive_sumo.agents.learned.fusion_spec import (
    BOX_NUMBERS,
    CLASSES,
    CODRIVING,
    FEATURE_CELL_M,
    FEATURE_CELLS,
    FEATURE_CHANNELS,
    FORECAST_S,
    GRID_CELLS,
    GRID_LAYERS,
    GRID_REACH_M,
    OUTPUT_CELLS,
    SHARING,
)
from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.core.onnx_manifest import write_manifest
from testing.onnx_writer import Array, Node, write_model

CAR_LAYERS, PERSON_LAYERS, VAN_LAYERS, WALL_LAYERS = slice(1, 4), slice(4, 5), slice(5, 6), slice(6, 8)
"""Height layers with points of cars (0.3 to 1.6 m), of persons, but no cars (1.6 to 2.0 m), of vans (2.0 to 2.8 m), and
of walls alone."""
SCORE = 0.9
SIDES_M = 4.5, 2.0
"""Of every box that it answers, along x."""
GRID_SAMPLE_OPSET = 16
CELLS = (FEATURE_CELLS, FEATURE_CELLS)


def write_encoder(seed: int = 0, layers: slice = CAR_LAYERS) -> bytes:
    """Feature 0 of a cell is 1 where it has points in these layers and none of a wall, the others are 0.

    The confidence is `SCORE` there.

    seed: a number in the file that changes nothing but its checksum.
    """
    constants: dict[str, np.ndarray] = {}
    nodes: list[Node] = []
    for name, counted in (("car", layers), ("wall", WALL_LAYERS)):
        kernel = np.zeros((1, GRID_LAYERS, 4, 4), np.float32)
        kernel[:, counted] = 1.0
        constants[f"{name}_kernel"] = kernel
        nodes += [
            Node("Conv", ("grid", f"{name}_kernel"), f"{name}_sum", (("strides", (4, 4)),)),
            Node("Sign", (f"{name}_sum",), name),
        ]
    constants["seed"] = np.full(1, seed, np.float32)
    constants["first"] = np.eye(1, FEATURE_CHANNELS, dtype=np.float32).reshape(1, -1, 1, 1)
    constants["score"] = np.full(1, SCORE, np.float32)
    constants["cells"] = np.array((1, *CELLS), np.int64)
    nodes += [
        Node("Sub", ("car", "wall"), "difference"),
        Node("Relu", ("difference",), "occupied"),
        Node("Mul", ("occupied", "first"), "features"),
        Node("Mul", ("occupied", "score"), "scored"),
        Node("Reshape", ("scored", "cells"), "confidence"),
    ]
    outputs = [Array("features", (1, FEATURE_CHANNELS, *CELLS)), Array("confidence", (1, *CELLS))]
    return write_model(nodes, constants, [Array("grid", (1, GRID_LAYERS, GRID_CELLS, GRID_CELLS))], outputs)


def write_fusion(name: str, uses_own: bool = True) -> bytes:
    """The largest feature 0 of all cars, moved by their poses. uses_own: False: what the own car sees is not used.

    `codriving` forecasts that what it sees stays where it is, and that tracks go on.
    """
    head, constants = _make_head()
    if name not in SHARING:
        nodes = [Node("ReduceMax", ("features",), "map", (("axes", (0,)), ("keepdims", 0))), *head]
        inputs = [Array("features", (FEATURE_CHANNELS, *CELLS))]
        return write_model(nodes, constants, inputs, _describe_outputs())
    offsets = (GRID_REACH_M - (np.arange(FEATURE_CELLS) + 0.5) * FEATURE_CELL_M).astype(np.float32)
    constants |= {
        "ahead": np.broadcast_to(offsets[:, None], CELLS).copy(),
        "left": np.broadcast_to(offsets[None, :], CELLS).copy(),
        "per_reach": np.full(1, -1.0 / GRID_REACH_M, np.float32),
        "as_cells": np.array((-1, 1, 1), np.int64),
        "as_places": np.array((-1, *CELLS, 1), np.int64),
        "begin": np.array((0 if uses_own else 1,), np.int64),
        "end": np.array((99,), np.int64),
        **{f"column{i}": np.array(i, np.int64) for i in range(3)},
    }
    nodes: list[Node] = []
    for i, part in enumerate(("x", "y", "yaw")):
        nodes.append(Node("Gather", ("pose", f"column{i}"), f"{part}_flat", (("axis", 1),)))
        nodes.append(Node("Reshape", (f"{part}_flat", "as_cells"), part))
    nodes += [
        Node("Cos", ("yaw",), "cos"),
        Node("Sin", ("yaw",), "sin"),
        Node("Sub", ("ahead", "x"), "dx"),
        Node("Sub", ("left", "y"), "dy"),
        *(Node("Mul", (one, other), f"{one}_{other}") for one in ("cos", "sin") for other in ("dx", "dy")),
        Node("Sub", ("cos_dy", "sin_dx"), "left_there"),
        Node("Add", ("cos_dx", "sin_dy"), "ahead_there"),
    ]
    for part in ("left_there", "ahead_there"):
        nodes.append(Node("Mul", (part, "per_reach"), f"{part}_scaled"))
        nodes.append(Node("Reshape", (f"{part}_scaled", "as_places"), f"{part}_place"))
    nodes += [
        Node("Concat", ("left_there_place", "ahead_there_place"), "places", (("axis", 3),)),
        Node("GridSample", ("features", "places"), "all_moved"),
        Node("Slice", ("all_moved", "begin", "end"), "moved"),
        Node("Concat", ("moved", "nothing"), "maps", (("axis", 0),)),
        Node("ReduceMax", ("maps",), "map", (("axes", (0, 1)), ("keepdims", 0))),
        *head,
    ]
    constants["nothing"] = np.zeros((1, FEATURE_CHANNELS, *CELLS), np.float32)
    inputs = [
        Array("features", ("cars", FEATURE_CHANNELS, *CELLS)),
        Array("arrived", ("cars", *CELLS)),
        Array("pose", ("cars", 3)),
        Array("age", ("cars",)),
    ]
    outputs = _describe_outputs()
    if name == CODRIVING:
        forecast = (len(FORECAST_S), OUTPUT_CELLS, OUTPUT_CELLS)
        nodes.append(Node("Max", ("map_fine", "tracks"), "occupancy"))
        inputs.append(Array("tracks", forecast))
        outputs.append(Array("occupancy", forecast))
    return write_model(nodes, constants, inputs, outputs, GRID_SAMPLE_OPSET)


def _describe_outputs() -> list[Array]:
    cells = (OUTPUT_CELLS, OUTPUT_CELLS)
    return [Array("scores", (len(CLASSES), *cells)), Array("numbers", (BOX_NUMBERS, *cells))]


def _make_head() -> tuple[list[Node], dict[str, np.ndarray]]:
    """A vehicle of `SIDES_M` at each of the four cells that lie in a cell of "map"."""
    numbers = np.zeros((BOX_NUMBERS, 1, 1), np.float32)
    numbers[2:, 0, 0] = *np.log(SIDES_M), 1.0, 0.0, 1.0
    constants = {
        "apart": np.array((FEATURE_CELLS, 1, FEATURE_CELLS, 1), np.int64),
        "four": np.ones((1, 2, 1, 2), np.float32),
        "whole": np.array((1, OUTPUT_CELLS, OUTPUT_CELLS), np.int64),
        "vehicle": SCORE * np.eye(1, len(CLASSES), dtype=np.float32).reshape(-1, 1, 1),
        "zero": np.zeros(1, np.float32),
        "box": numbers,
    }
    nodes = [
        Node("Reshape", ("map", "apart"), "map_apart"),
        Node("Mul", ("map_apart", "four"), "map_four"),
        Node("Reshape", ("map_four", "whole"), "map_fine"),
        Node("Mul", ("map_fine", "vehicle"), "scores"),
        Node("Mul", ("map_fine", "zero"), "map_zero"),
        Node("Add", ("map_zero", "box"), "numbers"),
    ]
    return nodes, constants


def save_tiny_detector(
    folder: Path, name: str, uses_own: bool = True, encoder_seed: int = 0, layers: slice = CAR_LAYERS
) -> Path:
    """Write NAME-encoder.onnx, NAME.onnx and their manifests; return the path of the second."""
    networks = {f"{name}-encoder": write_encoder(encoder_seed, layers), name: write_fusion(name, uses_own)}
    for part, content in networks.items():
        path = folder / f"{part}.onnx"
        path.write_bytes(content)
        manifest = WeightsManifest(
            system=part, sha256=hashlib.sha256(content).hexdigest(), bytes=len(content), parameters=0
        )
        write_manifest(manifest, path.with_suffix(".json"))
    return folder / f"{name}.onnx"
