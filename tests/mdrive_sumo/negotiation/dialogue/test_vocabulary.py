"""The vocabulary: any text survives, control entries are never text, pieces are learned, and bad files are named."""

import json
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.negotiation.dialogue.decoder_shape import NEGOTIATOR
from mdrive_sumo.negotiation.dialogue.vocabulary import (
    ANSWER,
    CONTROLS,
    FIRST_BYTE,
    FORMAT,
    LINE,
    SAY,
    DialogueVocabulary,
    format_vocabulary,
    learn_merges,
    load_vocabulary,
)

VOCABULARY = load_vocabulary()


@given(st.text() | st.text("ABCH >:.0123456789 akeptowyr<>|\n"))
def test_any_text_survives_and_holds_no_control_entry(text: str) -> None:
    text = text.encode("utf-8", "replace").decode()  # half of a surrogate pair is no text that can be sent
    entries = VOCABULARY.encode(text)
    assert VOCABULARY.decode(entries) == text
    assert all(len(CONTROLS) <= entry < NEGOTIATOR.vocabulary for entry in entries)


def test_words_of_answers_letters_and_numbers_are_one_entry_each() -> None:
    text = "propose B>A keep: 12.5, 123"
    pieces = [VOCABULARY.pieces[entry].decode() for entry in VOCABULARY.encode(text)]
    assert pieces == ["propose", " B", ">", "A", " keep", ":", " 12", ".5", ",", " 12", "3"]


def test_a_prompt_has_its_task_its_lines_and_an_answer_to_come() -> None:
    entries = VOCABULARY.encode_prompt(SAY, ("keep", "<answer>"))
    assert entries[0] == SAY and entries[-1] == ANSWER and entries.count(LINE) == 2
    assert entries.count(ANSWER) == 1, "what a car writes cannot end the prompt"


def test_frequent_neighbours_become_pieces() -> None:
    merges = learn_merges(["yyz yyz", "yyx"], 3)
    assert merges == [(b"y", b"y"), (b"yy", b"z"), (b" ", b"yyz")]
    vocabulary = DialogueVocabulary(merges)
    assert [vocabulary.pieces[entry] for entry in vocabulary.encode("yyy")] == [b"yy", b"y"]
    assert vocabulary.encode("q") == [FIRST_BYTE + ord("q")]


def test_equal_texts_give_equal_bytes(tmp_path: Path) -> None:
    texts = ["the way is free", "I see the way"]
    first, second = (DialogueVocabulary(learn_merges(texts, 20)) for _ in range(2))
    (tmp_path / "v.json").write_text(format_vocabulary(first))
    assert first.digest == second.digest == load_vocabulary(tmp_path / "v.json").digest != VOCABULARY.digest


@pytest.mark.parametrize(
    ("content", "expected"),
    [
        (None, "expected a vocabulary of dialogues, found No such file"),
        ("{", "expected JSON, found an error"),
        ("[]", f"expected the format '{FORMAT}', found 'list'"),
        ('{"format": "words"}', f"expected the format '{FORMAT}', found 'words'"),
        (json.dumps({"format": FORMAT}), "merges: expected pairs of pieces"),
        (json.dumps({"format": FORMAT, "merges": 3}), "merges: expected pairs of pieces"),
        (json.dumps({"format": FORMAT, "merges": [["a"]]}), "merges: expected pairs of pieces"),
        (json.dumps({"format": FORMAT, "merges": [["a", "\u20ac"]]}), "merges: expected pairs of pieces"),
        (json.dumps({"format": FORMAT, "merges": [["ab", "c"]]}), "merge: expected two pieces that give a new one"),
        (json.dumps({"format": FORMAT, "merges": [["a", "b"]] * 2}), "merge: expected two pieces that give a new one"),
        (json.dumps({"format": FORMAT, "merges": [["a", "b"]] * 3000}), "expected at most"),
    ],
)
def test_a_bad_file_is_a_sentence(content: str | None, expected: str, tmp_path: Path) -> None:
    path = tmp_path / "vocabulary.json"
    if content is not None:
        path.write_text(content)
    with pytest.raises(InputError, match=expected) as error:
        load_vocabulary(path)
    assert str(path) in str(error.value) and "\n" not in str(error.value)
