"""Writes a negotiator's network that says after each entry which one it would like next, and remembers nothing."""

import hashlib
from pathlib import Path

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.onnx_manifest import write_manifest
from mdrive_sumo.negotiation.dialogue.decoder_shape import DecoderShape
from mdrive_sumo.negotiation.dialogue.dialogue_manifest import SYSTEM, DialogueManifest
from mdrive_sumo.negotiation.dialogue.vocabulary import load_vocabulary
from testing.onnx_writer import Array, Node, write_model

SHAPE = DecoderShape(width=2, layers=1, heads=1, shared_heads=1, mlp_width=1)


def write_tiny_negotiator(
    folder: Path, scores: npt.NDArray[np.float32] | None = None, system: str = SYSTEM, vocabulary: str = ""
) -> Path:
    """Write negotiator.onnx and its manifest. scores: (vocabulary, vocabulary) of the next entry, by the last one."""
    if scores is None:
        scores = np.zeros((SHAPE.vocabulary, SHAPE.vocabulary), np.float32)
    nodes = (
        Node("Gather", ("table", "entries"), "rows"),
        Node("Gather", ("rows", "last"), "scores"),
        Node("Gather", ("nothing", "entries"), "present"),
    )
    nothing = np.zeros((SHAPE.vocabulary, *SHAPE.cache_shape), np.float32)
    constants = {"table": scores, "nothing": nothing, "last": np.array(-1)}
    inputs = (Array("entries", ("entries",), "int64"), Array("past", ("positions", *SHAPE.cache_shape)))
    outputs = (Array("scores", (SHAPE.vocabulary,)), Array("present", ("entries", *SHAPE.cache_shape)))
    content = write_model(nodes, constants, inputs, outputs)
    path = folder / "negotiator.onnx"
    path.write_bytes(content)
    digest = hashlib.sha256(content).hexdigest()
    manifest = DialogueManifest(
        system=system, sha256=digest, bytes=len(content), parameters=0,
        vocabulary=vocabulary or load_vocabulary().digest, shape=SHAPE,
    )  # fmt: skip
    write_manifest(manifest, path.with_suffix(".json"))
    return path
