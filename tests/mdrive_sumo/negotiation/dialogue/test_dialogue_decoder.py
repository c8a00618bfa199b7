"""The decoder says what the network prefers and the grammar allows, reads each entry once, and names defects."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from testing.tiny_negotiator import SHAPE, write_tiny_negotiator

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.negotiation.dialogue.dialogue_decoder import READ_AT_ONCE, DialogueDecoder, load_decoder
from mdrive_sumo.negotiation.dialogue.vocabulary import AGREE, ANSWER, SAY, load_vocabulary

VOCABULARY = load_vocabulary()


def prefer(*texts: str) -> np.ndarray[Any, np.dtype[np.float32]]:
    """Scores that make a network say each of these texts once begun."""
    scores = np.zeros((SHAPE.vocabulary, SHAPE.vocabulary), np.float32)
    for text in texts:
        entries = [ANSWER, *VOCABULARY.encode(text)]
        scores[entries[:-1], entries[1:]] = 1.0
        scores[entries[-1], 1] = 1.0
    return scores


def test_the_network_says_what_it_prefers(tmp_path: Path) -> None:
    decoder = load_decoder(write_tiny_negotiator(tmp_path, prefer("object B>A slower: I pass")))
    found = decoder.answer(SAY, ("me B",), "AB", (8, 8))
    assert found.text == "object B>A slower: I pass"
    assert found.read_entries == len(VOCABULARY.encode_prompt(SAY, ("me B",)))
    assert decoder.answer(SAY, ("me B",), "AB", has_words=False).text == "object B>A slower"


def test_a_preference_that_the_grammar_forbids_is_passed_over(tmp_path: Path) -> None:
    decoder = load_decoder(write_tiny_negotiator(tmp_path, prefer("C>C>C keep keep keep 100", "accept accept")))
    assert decoder.answer(AGREE, (), "AB").text.startswith(("A>B", "B>A"))
    assert decoder.answer(SAY, (), "AB").text.startswith("accept ")


class CountingSession:
    """A network that remembers the entries which it has read."""

    def __init__(self) -> None:
        self.read: list[list[int]] = []
        self.past: list[int] = []

    def run(self, _names: list[str], inputs: dict[str, Any]) -> list[Any]:
        self.read.append(inputs["entries"].tolist())
        self.past.append(len(inputs["past"]))
        present = np.zeros((len(inputs["entries"]), *SHAPE.cache_shape), np.float32)
        return [np.zeros(SHAPE.vocabulary, np.float32), present]


def test_each_entry_is_read_once_and_forced_ones_with_the_next() -> None:
    session = CountingSession()
    answer = DialogueDecoder(SHAPE, session, VOCABULARY).answer(AGREE, ("rules",), "AB")
    read = [entry for entries in session.read for entry in entries]
    assert session.past == [sum(map(len, session.read[:i])) for i in range(len(session.read))]
    written = VOCABULARY.encode(answer.text)
    assert read == VOCABULARY.encode_prompt(AGREE, ("rules",)) + written[:-1]
    assert len(session.read) == 4, "first letter, two actions, consensus: the arrow and the last letter are forced"


def test_a_prompt_that_is_too_long_is_refused() -> None:
    decoder = DialogueDecoder(SHAPE, CountingSession(), VOCABULARY)
    with pytest.raises(ValueError, match=f"expected at most {decoder.longest_prompt} entries, found"):
        decoder.answer(SAY, ["keep"] * 500, "AB")


def test_bad_weights_are_a_sentence(tmp_path: Path) -> None:
    cases: list[tuple[Path, str]] = []
    for i, (change, expected) in enumerate(
        (
            ({"system": "tcp"}, "expected those of the negotiator, found those of 'tcp'"),
            ({"vocabulary": "0" * 32}, "expected those of the vocabulary"),
            ({}, "expected the checksum"),
        )
    ):
        folder = tmp_path / str(i)
        folder.mkdir()
        cases.append((write_tiny_negotiator(folder, **change), expected))
    cases[-1][0].write_bytes(b"other weights")
    cases.append((tmp_path / "none.onnx", "cannot be read"))
    for path, expected in cases:
        with pytest.raises(InputError, match=expected) as error:
            load_decoder(path)
        assert "\n" not in str(error.value)


def test_a_network_with_other_arrays_is_refused(tmp_path: Path) -> None:
    path = write_tiny_negotiator(tmp_path)
    manifest = path.with_suffix(".json")
    manifest.write_text(manifest.read_text().replace('"layers": 1', '"layers": 2'))
    with pytest.raises(InputError, match=r"'past': expected float32 \['positions', 2, 2, 1, 2\] of the negotiator"):
        load_decoder(path)


def test_a_long_prompt_is_read_in_parts() -> None:
    session = CountingSession()
    lines = ["keep, " * 10] * 10
    answer = DialogueDecoder(SHAPE, session, VOCABULARY).answer(AGREE, lines, "AB")
    assert [len(entries) for entries in session.read[:2]] == [READ_AT_ONCE, answer.read_entries - READ_AT_ONCE]
    assert session.past[:3] == [0, READ_AT_ONCE, answer.read_entries]
