"""Weights of a learned system: an ONNX file and the manifest beside it, loaded and checked for ONNX Runtime.

pydantic and ONNX Runtime are imported when weights are loaded, so that other commands start without them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mdrive_sumo.agents.learned.network_inputs import Inputs, describe_inputs, describe_outputs
from mdrive_sumo.agents.learned.plan_anchors import build_anchors, decode_plans
from mdrive_sumo.agents.learned.system_spec import SystemSpec
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.onnx_weights import check_arrays, check_runtime, create_session, read_checked_weights

if TYPE_CHECKING:
    from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest

WEIGHTS_FOLDER = Path(__file__).parent / "weights"
"""Packaged weights: NAME.onnx and NAME.json for each system."""
CACHED_NETWORKS = 8
"""Networks that a process keeps loaded; there are four systems."""


@dataclass(frozen=True, slots=True)
class DrivingNetwork:
    """A loaded network. It has no state: all agents of a process that use the same weights share it."""

    manifest: "WeightsManifest"
    provider: str
    """Execution provider of ONNX Runtime that runs it."""
    session: Any
    """`onnxruntime.InferenceSession`"""

    def run(self, inputs: Inputs) -> Inputs:
        """Return the outputs by name, with the `plan` that anchors decide; both without the batch dimension."""
        names = [output.name for output in self.session.get_outputs()]
        batch = {name: np.ascontiguousarray(value[None]) for name, value in inputs.items()}
        outputs = dict(zip(names, (value[0] for value in self.session.run(names, batch)), strict=True))
        if "anchor_scores" in outputs:
            outputs["plan"] = decode_plans(outputs["anchor_scores"], outputs["anchor_offsets"]).astype(np.float32)
        return outputs


def find_encoder(file: Path) -> Path:
    """Return the file of the encoder that lies beside a detector's .onnx or .json file."""
    return file.with_name(f"{file.stem}-encoder.onnx")


def load_network(spec: SystemSpec, path: Path | None = None, use_gpu: bool = True) -> DrivingNetwork:
    """Return the network of a system. path: its .onnx or .json file, the other lies beside it; None: as packaged.

    use_gpu: run on a GPU if the installed ONNX Runtime can. Raises InputError with one sentence if the extra, a file
    or its match with the system is missing.
    """
    file = (path or WEIGHTS_FOLDER / f"{spec.name}.onnx").with_suffix(".onnx")
    return _open_network(spec, file, read_checked_manifest(file, spec.name), use_gpu)


def read_checked_manifest(file: Path, system: str) -> "WeightsManifest":
    """Return the manifest of a .onnx file. Raises InputError as `load_network`, also for weights of another system."""
    check_runtime(system)
    from mdrive_sumo.agents.learned.weights_manifest import WeightsManifest
    from mdrive_sumo.core.onnx_manifest import read_manifest

    manifest = read_manifest(file.with_suffix(".json"), WeightsManifest)
    if manifest.system != system:
        raise InputError(f"weights {file}: expected those of the system {system!r}, found {manifest.system!r}")
    read_checked_weights(file, manifest.sha256)  # also if it is loaded already: the file may have been replaced
    return manifest


@lru_cache(maxsize=CACHED_NETWORKS)
def _open_network(spec: SystemSpec, file: Path, manifest: "WeightsManifest", use_gpu: bool) -> DrivingNetwork:
    """Return the network; the manifest is part of the key, so new weights under an old name are loaded anew."""
    if manifest.plan_head == "anchors" and manifest.anchors != (digest := build_anchors().digest):
        raise InputError(
            f"weights {file}: expected scores of the plan anchors {digest}, found those of {manifest.anchors!r:.20};"
            " train them with this version of mdrive-sumo"
        )
    memory_shape = manifest.memory_shape
    shapes = describe_inputs(spec, memory_shape, has_limits=manifest.has_limits)
    inputs = {name: f"{kind} {[1, *shape]}" for name, (shape, kind) in shapes.items()}
    outputs = {
        name: f"float32 {[1, *shape]}"
        for name, shape in describe_outputs(spec, memory_shape, manifest.plan_head).items()
    }
    return open_weights(file, manifest, inputs, outputs, use_gpu)


def open_weights(
    file: Path, manifest: "WeightsManifest", inputs: Mapping[str, str], outputs: Mapping[str, str], use_gpu: bool
) -> DrivingNetwork:
    """Return a network. inputs, outputs: dtype and shape that it must have, as texts, by name. Raises InputError."""
    provider, session = create_session(file, read_checked_weights(file, manifest.sha256), use_gpu)
    check_arrays(file, session, f"the system {manifest.system}", {"input": inputs, "output": outputs})
    return DrivingNetwork(manifest, provider, session)
