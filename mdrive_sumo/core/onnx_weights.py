"""Files of weights for ONNX Runtime: checksum, session on one core, and the arrays that a network must have.

ONNX Runtime is imported when weights are loaded, so that other commands start without it.
"""

import hashlib
import importlib.util
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.installation_command import format_installation

GPU_PROVIDER, CPU_PROVIDER = "CUDAExecutionProvider", "CPUExecutionProvider"
ERRORS_ONLY = 3
"""Severity of what ONNX Runtime prints."""


def check_runtime(agent: str) -> None:
    """Raise InputError unless ONNX Runtime is installed, which runs the networks of an agent."""
    if importlib.util.find_spec("onnxruntime") is None:
        raise InputError(
            f"agent {agent}: expected ONNX Runtime to run its network, found none installed;"
            f" {format_installation('learned')}"
        )


def read_checked_weights(file: Path, sha256: str) -> bytes:
    """Return the bytes of a file of weights. sha256: hexadecimal, of its manifest. Raises InputError."""
    try:
        content = read_bytes(file)
    except OSError as error:
        raise InputError(f"weights {file}: cannot be read: {error.strerror}") from None
    found = hashlib.sha256(content).hexdigest()
    if found != sha256:
        raise InputError(
            f"weights {file}: expected the checksum {sha256[:16]}... of its manifest, found {found[:16]}...;"
            " the file is damaged or was replaced: export it again"
        )
    return content


def create_session(file: Path, content: bytes, use_gpu: bool) -> tuple[str, Any]:
    """Return the provider and an `InferenceSession` that gives the same numbers in every run on one machine.

    One thread: sums are added in one order, and the workers of a run already occupy the cores. Raises InputError.
    """
    import onnxruntime
    from onnxruntime.capi import onnxruntime_pybind11_state as state  # pyright: ignore[reportAttributeAccessIssue]

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.execution_mode = onnxruntime.ExecutionMode.ORT_SEQUENTIAL
    options.use_deterministic_compute = True
    options.log_severity_level = ERRORS_ONLY
    providers = [CPU_PROVIDER]
    if use_gpu and GPU_PROVIDER in onnxruntime.get_available_providers():
        providers.insert(0, GPU_PROVIDER)
    errors = (state.Fail, state.InvalidProtobuf, state.InvalidGraph, state.InvalidArgument, state.NotImplemented)
    try:
        session = onnxruntime.InferenceSession(content, options, providers=providers)
    except (*errors, state.RuntimeException) as error:
        reason = str(error).splitlines()[0]
        raise InputError(
            f"weights {file}: expected a network for ONNX Runtime {onnxruntime.__version__}, found {reason:.200}"
        ) from None
    return session.get_providers()[0], session


def check_arrays(file: Path, session: Any, owner: str, arrays: Mapping[str, Mapping[str, str]]) -> None:
    """Raise InputError unless a network has these inputs and outputs.

    owner: whose they are, such as "the system tcp". arrays: dtype and shape as text by name, of "input" and "output".
    """
    for what, of_network in (("input", session.get_inputs()), ("output", session.get_outputs())):
        expected = arrays[what]
        found = {array.name: f"{_name_type(array.type)} {list(array.shape)}" for array in of_network}
        for name in sorted({*expected, *found}):
            wanted, has = expected.get(name, "none"), found.get(name, "none")
            if wanted != has:
                raise InputError(
                    f"weights {file}: {what} {name!r}: expected {wanted} of {owner}, found {has};"
                    " export it again with this version of mdrive-sumo"
                )


def _name_type(onnx_type: str) -> str:
    """Return the name of the dtype of an ONNX type: "tensor(float)" is "float32"."""
    name = onnx_type.removeprefix("tensor(").removesuffix(")")
    return {"float": "float32", "double": "float64"}.get(name, name)
