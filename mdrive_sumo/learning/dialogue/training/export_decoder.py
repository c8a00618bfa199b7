"""export_decoder: the negotiator's network as ONNX with 8-bit weights, checked against PyTorch."""

import hashlib
import logging
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import onnx
import torch

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.core.onnx_manifest import write_manifest
from mdrive_sumo.core.onnx_weights import create_session
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.learning.dialogue.dialogue_samples import DialogueSamples
from mdrive_sumo.learning.dialogue.evaluate_decoder import write_answer
from mdrive_sumo.learning.dialogue.networks.decoder_network import CachedDecoder, DecoderNetwork
from mdrive_sumo.learning.dialogue.training.run_dialogue_training import check_vocabulary
from mdrive_sumo.learning.networks.build_network import count_parameters
from mdrive_sumo.learning.training.checkpoint import Checkpoint, take_weights
from mdrive_sumo.learning.training.export_network import OnnxFile, find_largest, store_half, write_onnx
from mdrive_sumo.negotiation.dialogue.decoder_shape import DecoderShape
from mdrive_sumo.negotiation.dialogue.dialogue_decoder import DialogueDecoder
from mdrive_sumo.negotiation.dialogue.dialogue_manifest import SYSTEM, DialogueManifest
from mdrive_sumo.negotiation.dialogue.vocabulary import DialogueVocabulary, load_vocabulary

MOST_BYTES = 12_000_000
"""Bytes of the file of weights: it is part of the package."""
MOST_DIFFERENCE = 1e-3
"""Between scores of the exported network in single precision and PyTorch's."""
LEAST_EQUAL = 0.97
"""Share of answers whose head is the same with weights rounded to 8 bits; chosen."""
CHECKED = 64
"""Dialogues that both networks are compared on, spread over those given."""


@dataclass(frozen=True, slots=True)
class ExportedDecoder:
    """The two files, and how they compare with PyTorch."""

    network: Path
    manifest: Path
    difference: float
    """Largest difference of scores before rounding."""
    equal_heads: float
    """Share of the heads that rounding leaves as they are."""
    message_ms: tuple[float, float]
    """Median and 99th percentile of the processor time [ms] of an answer with its words."""


def export_decoder(
    checkpoint: Checkpoint, path: Path, samples: DialogueSamples, folder: Path, least_equal: float = LEAST_EQUAL
) -> ExportedDecoder:
    """Write DIR/negotiator.onnx and DIR/negotiator.json from a checkpoint's best weights.

    path: of the checkpoint, for errors. samples: dialogues of the packaged vocabulary to compare answers on.
    least_equal: share of heads that rounding must leave as they are. Raises InputError if the weights are
    of another vocabulary, the file is too large, or answers otherwise than PyTorch.
    """
    check_vocabulary(path, checkpoint, samples.vocabulary)
    network = build_checkpoint_network(checkpoint)
    make_folder(folder)
    file = folder / f"{SYSTEM}.onnx"
    rows = np.unique(np.linspace(0, len(samples) - 1, CHECKED).astype(int))
    with TemporaryDirectory() as drafts:
        exact = Path(drafts) / "exact.onnx"
        write_decoder(network, exact)
        exact_file = OnnxFile(exact)
        difference = find_largest(_compare_scores(network, exact_file, samples, row) for row in rows[:4].tolist())
        quantise(exact, file)
        decoders = [_open_decoder(each, network.shape, load_vocabulary()) for each in (exact, file)]
        heads = [
            [write_answer(decoder, samples, row, has_words=False) for row in rows.tolist()] for decoder in decoders
        ]
        message_ms = _time_answers(decoders[1], samples, rows.tolist())
    equal = float(np.mean([one == other for one, other in zip(*heads, strict=True)]))
    _check(file, difference, equal, least_equal)
    content = read_bytes(file)
    summary: dict[str, Any] = checkpoint.summary | {"equal_heads": equal, "message_ms": [*message_ms]}
    manifest = DialogueManifest(
        system=SYSTEM,
        sha256=hashlib.sha256(content).hexdigest(),
        bytes=len(content),
        parameters=count_parameters(network),
        vocabulary=samples.vocabulary,
        shape=network.shape,
        training=summary,
    )
    write_manifest(manifest, file.with_suffix(".json"))
    return ExportedDecoder(file, file.with_suffix(".json"), difference, equal, message_ms)


def build_checkpoint_network(checkpoint: Checkpoint) -> DecoderNetwork:
    """Return the network with a checkpoint's best weights. Raises InputError for those of another network."""
    try:
        shape = DecoderShape(**checkpoint.summary["shape"])
    except (KeyError, TypeError):
        raise InputError(f"checkpoint of {checkpoint.system!r}: expected the shape of a decoder, found none") from None
    network = DecoderNetwork(shape)
    take_weights(network, checkpoint.chosen, checkpoint.system)
    return network.eval()


def write_decoder(network: DecoderNetwork, path: Path) -> None:
    """Write the network with its cache as ONNX in single precision."""
    shape = network.shape
    sample = {
        "entries": torch.arange(4),
        "past": torch.zeros(3, *shape.cache_shape),  # not empty, or the exporter would drop it
    }
    lengths = {"entries": {0: "entries"}, "past": {0: "positions"}, "present": {0: "entries"}}
    write_onnx(CachedDecoder(network).eval(), sample, ["scores", "present"], path, lengths, is_halved=False)


def quantise(source: Path, path: Path) -> None:
    """Round the matrices of a network to 8 bits, and its embedding to half precision.

    Weights are rounded to 7 bits for each output: processors without VNNI add two products of 8 bits in 16, which
    overflows with 8. Activations are rounded as they come.
    """
    from onnxruntime.quantization import QuantType, quantize_dynamic  # here: only an export needs it

    logger = logging.getLogger()
    level = logger.level
    logger.setLevel(logging.ERROR)  # it recommends a preparation that changes nothing here
    try:
        quantize_dynamic(
            source, path, op_types_to_quantize=["MatMul"], per_channel=True, reduce_range=True,
            weight_type=QuantType.QInt8,
        )  # fmt: skip
    finally:
        logger.setLevel(level)
    model = onnx.load(str(path))
    store_half(model)
    onnx.checker.check_model(model)
    onnx.save(model, str(path))


def _open_decoder(file: Path, shape: DecoderShape, vocabulary: DialogueVocabulary) -> DialogueDecoder:
    return DialogueDecoder(shape, create_session(file, read_bytes(file), use_gpu=False)[1], vocabulary)


def _compare_scores(network: DecoderNetwork, file: OnnxFile, samples: DialogueSamples, row: int) -> float:
    """Return the largest difference of the scores after a dialogue that the file reads in two parts."""
    entries = torch.from_numpy(samples.entries[row, : samples.length[row]].astype(np.int64))
    with torch.no_grad():
        expected = network.score(network(entries[None]))[0, -1].numpy()
    start = int(samples.answer_start[row])
    past = file.run({"entries": entries[:start], "past": torch.zeros(0, *network.shape.cache_shape)})["present"]
    found = file.run({"entries": entries[start:], "past": torch.from_numpy(past)})["scores"]
    return float(np.abs(found - expected).max())


def _time_answers(decoder: DialogueDecoder, samples: DialogueSamples, rows: Sequence[int]) -> tuple[float, float]:
    """Return median and 99th percentile of the processor time [ms] of answers; each is written twice."""
    times: list[float] = []
    for row in (*rows, *rows):
        began = time.process_time()
        write_answer(decoder, samples, row, has_words=True)
        times.append(1e3 * (time.process_time() - began))
    return float(np.median(times)), float(np.percentile(times, 99))


def _check(file: Path, difference: float, equal: float, least_equal: float) -> None:
    if not difference <= MOST_DIFFERENCE:
        raise InputError(
            f"{file}: expected scores within {MOST_DIFFERENCE} of PyTorch's, found a difference of {difference:.3g}"
        )
    if not equal >= least_equal:
        raise InputError(
            f"{file}: expected {least_equal:.0%} of the heads of answers to survive rounding to 8 bits, found"
            f" {equal:.1%}"
        )
    size = file.stat().st_size
    if size > MOST_BYTES:
        raise InputError(f"{file}: expected at most {MOST_BYTES} bytes, found {size}: make the network smaller")
