"""Tiny networks with the inputs and outputs of a learned system, and weights files of them. No tests in here."""

import hashlib
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.agents.learned.network_inputs import describe_inputs, describe_outputs
from mdrive_sumo.agents.learned.system_spec import COMMANDS, NAVIGATION_SIZE, PLAN_INTERVAL_S, PLAN_POINTS, SystemSpec
from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
from mdrive_sumo.core.onnx_manifest import write_manifest
from testing.onnx_writer import Array, Node, write_model

MEMORY = (2, 3, 4)
FIRST_TARGET = slice(1 + len(COMMANDS), 3 + len(COMMANDS))
"""Of the navigation vector: the target point 10 m ahead, in units of 20 m."""


@dataclass(frozen=True)
class TinyNetwork:
    """What a network answers: points ahead at `speed`, bent to the first target point, shifted by images and memory."""

    speed: float = 4.0
    """[m/s]"""
    ahead_per_grey: float = 0.0
    """[m] By which x of every point grows with the mean of the first images."""
    ahead_per_memory: float = 0.0
    """[m] By which x of every point grows with the mean of the memory, which grows by 1 a decision."""
    control: tuple[float, float, float] = (0.4, 0.0, 0.0)

    def write(self, spec: SystemSpec) -> bytes:
        """Return an ONNX file."""
        memory = MEMORY if spec.uses_memory else ()
        inputs = [Array(name, (1, *shape), kind) for name, (shape, kind) in describe_inputs(spec, memory).items()]
        outputs = [Array(name, (1, *shape)) for name, shape in describe_outputs(spec, memory).items()]
        constants = {
            "weights": self._build_weights(),
            "way": np.column_stack((self._build_way(), np.zeros(PLAN_POINTS))).astype(np.float32).reshape(1, -1),
            "per_grey": np.tile(np.float32((self.ahead_per_grey, 0.0)), PLAN_POINTS),
            "per_memory": np.tile(np.float32((self.ahead_per_memory, 0.0)), PLAN_POINTS),
            "shape": np.array((1, PLAN_POINTS, 2), np.int64),
            "pedals": np.array((self.control,), np.float32),
            "one": np.ones(1, np.float32),
        }
        nodes = [
            Node("Cast", (spec.images[0].name,), "pixels", (("to", 1),)),
            Node("ReduceMean", ("pixels",), "grey", (("keepdims", 0),)),
            Node("Mul", ("grey", "per_grey"), "shift"),
            Node("MatMul", ("navigation", "weights"), "aside"),
            Node("Add", ("aside", "way"), "on"),
            Node("Add", ("on", "shift"), "flat"),
        ]
        last = "flat"
        if spec.uses_memory:
            nodes += [
                Node("ReduceMean", ("memory",), "remembered", (("keepdims", 0),)),
                Node("Mul", ("remembered", "per_memory"), "push"),
                Node("Add", ("flat", "push"), "pushed"),
                Node("Add", ("memory", "one"), "bev"),
            ]
            last = "pushed"
        nodes.append(Node("Reshape", (last, "shape"), "plan"))
        if spec.answers_control:
            nodes.append(Node("Identity", ("pedals",), "control"))
        return write_model(nodes, constants, inputs, outputs)

    def _build_weights(self) -> np.ndarray:
        """y of the points: the target point is about 10 m ahead and told in units of 20 m."""
        weights = np.zeros((NAVIGATION_SIZE, PLAN_POINTS, 2), np.float32)
        weights[FIRST_TARGET.stop - 1, :, 1] = 20.0 * self._build_way() / 10.0
        return weights.reshape(NAVIGATION_SIZE, -1)

    def _build_way(self) -> np.ndarray:
        """x of the points (PLAN_POINTS,) [m]."""
        return self.speed * PLAN_INTERVAL_S * np.arange(1, PLAN_POINTS + 1)


def save_tiny_weights(folder: Path, spec: SystemSpec, network: TinyNetwork | None = None) -> Path:
    """Write NAME.onnx and its manifest; return the path of the former."""
    content = (network or TinyNetwork()).write(spec)
    path = folder / f"{spec.name}.onnx"
    path.write_bytes(content)
    write_manifest(
        WeightsManifest(
            system=spec.name, sha256=hashlib.sha256(content).hexdigest(), bytes=len(content), parameters=0,
            memory_shape=MEMORY if spec.uses_memory else (),
        ),
        path.with_suffix(".json"),
    )  # fmt: skip
    return path
