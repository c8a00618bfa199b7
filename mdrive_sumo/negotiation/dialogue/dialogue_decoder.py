"""DialogueDecoder: writes the answers of the negotiator's network, one entry after the other, on one core."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.onnx_weights import check_arrays, check_runtime, create_session, read_checked_weights
from mdrive_sumo.negotiation.dialogue.answer_grammar import MAX_ANSWER_ENTRIES, AnswerEntries, AnswerGrammar
from mdrive_sumo.negotiation.dialogue.answers import MAX_MESSAGE_BYTES
from mdrive_sumo.negotiation.dialogue.decoder_shape import DecoderShape
from mdrive_sumo.negotiation.dialogue.vocabulary import END, SAY, DialogueVocabulary, load_vocabulary

if TYPE_CHECKING:
    from mdrive_sumo.negotiation.dialogue.dialogue_manifest import DialogueManifest

AGENT = "colmdriver"
"""Agent that drives with the network, for errors."""
WEIGHTS = Path(__file__).parent / "weights" / "negotiator.onnx"
"""Packaged weights, the manifest beside them."""

READ_AT_ONCE = 128
"""Entries: no attention of early entries to late ones is computed, and it stays in the processor's cache. A prompt
of 420 entries takes 60 ms instead of 108 ms, one of 130 the same. Features are rounded by the range of each part, so
another number could change an answer."""


@dataclass(frozen=True, slots=True)
class DialogueAnswer:
    """An answer, and what it took."""

    text: str
    read_entries: int
    """Entries of the prompt."""
    written_entries: int
    """Entries of the answer, the end included."""


class _Reading:
    """What the network remembers of the entries of one dialogue."""

    def __init__(self, session: Any, shape: DecoderShape) -> None:
        self._session = session
        self._cache = np.empty((shape.context, *shape.cache_shape), np.float32)
        self._cached = 0

    def read(self, entries: Sequence[int]) -> npt.NDArray[np.float32]:
        """Return the scores (vocabulary,) of the entry after these, which follow those read before."""
        scores = np.zeros(0, np.float32)
        for start in range(0, len(entries), READ_AT_ONCE):
            part = np.array(entries[start : start + READ_AT_ONCE], np.int64)
            inputs = {"entries": part, "past": self._cache[: self._cached]}
            scores, present = self._session.run(["scores", "present"], inputs)
            self._cache[self._cached : self._cached + len(part)] = present
            self._cached += len(part)
        return scores


class DialogueDecoder:
    """A loaded network. It has no state: all CAVs of a process share it."""

    def __init__(self, shape: DecoderShape, session: Any, vocabulary: DialogueVocabulary) -> None:
        self.shape = shape
        self.vocabulary = vocabulary
        self._session = session
        self.entries = AnswerEntries.find(vocabulary)

    @property
    def longest_prompt(self) -> int:
        """Entries that a prompt may have, so that the longest answer still fits."""
        return self.shape.context - MAX_ANSWER_ENTRIES

    def answer(
        self,
        task: int,
        lines: Sequence[str],
        letters: str,
        id_bytes: Sequence[int] = (),
        max_bytes: int = MAX_MESSAGE_BYTES,
        has_words: bool = True,
    ) -> DialogueAnswer:
        """Return the most likely answer of the grammar to a prompt; the arguments are those of `AnswerGrammar`.

        Raises ValueError for a prompt that is too long.
        """
        prompt = self.vocabulary.encode_prompt(task, lines)
        if len(prompt) > self.longest_prompt:
            raise ValueError(f"prompt: expected at most {self.longest_prompt} entries, found {len(prompt)}")
        grammar = AnswerGrammar(self.entries, task, letters, id_bytes, max_bytes, has_words and task == SAY)
        written = self.write(prompt, grammar)
        return DialogueAnswer(self.vocabulary.decode(written), len(prompt), len(written))

    def write(self, prompt: Sequence[int], grammar: AnswerGrammar) -> list[int]:
        """Return the entries of an answer. Entries without a choice are read together with the next one chosen."""
        reading = _Reading(self._session, self.shape)
        unread = list(prompt)
        written: list[int] = []
        while not grammar.is_complete:
            entry = int(grammar.allowed[0])
            if len(grammar.allowed) > 1:
                scores = reading.read(unread)
                entry = int(grammar.allowed[np.argmax(scores[grammar.allowed])])
                unread = []
            grammar.advance(entry)
            unread.append(entry)
            written.append(entry)
        assert written[-1] == END, "every answer of the grammar has an end"
        return written


def load_decoder(path: Path = WEIGHTS, vocabulary: DialogueVocabulary | None = None) -> DialogueDecoder:
    """Return the negotiator's network. path: its .onnx or .json file, the other lies beside it.

    vocabulary: None: the packaged one. Raises InputError with one sentence if the extra, a file or its match with the
    vocabulary is missing.
    """
    check_runtime(AGENT)
    from mdrive_sumo.core.onnx_manifest import read_manifest
    from mdrive_sumo.negotiation.dialogue.dialogue_manifest import SYSTEM, DialogueManifest

    file = path.with_suffix(".onnx")
    manifest = read_manifest(file.with_suffix(".json"), DialogueManifest)
    if manifest.system != SYSTEM:
        raise InputError(f"weights {file}: expected those of the {SYSTEM}, found those of {manifest.system!r:.40}")
    vocabulary = vocabulary or load_vocabulary()
    if manifest.vocabulary != vocabulary.digest:
        raise InputError(
            f"weights {file}: expected those of the vocabulary {vocabulary.digest[:8]}..., found those of"
            f" {manifest.vocabulary[:8]}...; train them with this version of mdrive-sumo"
        )
    return DialogueDecoder(manifest.shape, _open_session(file, manifest), vocabulary)


@lru_cache(maxsize=2)
def _open_session(file: Path, manifest: "DialogueManifest") -> Any:
    """Return the session; the manifest is part of the key, so new weights under an old name are loaded anew."""
    content = read_checked_weights(file, manifest.sha256)
    session = create_session(file, content, use_gpu=False)[1]
    check_arrays(file, session, "the negotiator", describe_arrays(manifest.shape))
    return session


def describe_arrays(shape: DecoderShape) -> dict[str, dict[str, str]]:
    """Return dtype and shape of the inputs and outputs of a network, as texts."""
    cache = list(shape.cache_shape)

    def describe(kind: str, *sizes: object) -> str:
        return f"{kind} {list(sizes)}"

    return {
        "input": {"entries": describe("int64", "entries"), "past": describe("float32", "positions", *cache)},
        "output": {
            "scores": describe("float32", shape.vocabulary),
            "present": describe("float32", "entries", *cache),
        },
    }
