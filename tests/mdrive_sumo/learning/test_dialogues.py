"""Dialogues as arrays and on disk: bounds and fields, and files that are damaged or of another kind."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.learning.array_files import read_arrays, write_arrays
from mdrive_sumo.learning.dialogue.dialogue_files import INDEX_NAME, read_dialogues, read_pairs, write_dialogues
from mdrive_sumo.learning.dialogue.dialogue_samples import (
    UNKNOWN,
    Dialogue,
    DialogueSamples,
    check_places_differ,
    encode_dialogues,
)
from mdrive_sumo.learning.dialogue.synthetic_dialogues import (
    build_synthetic_dialogues,
    build_synthetic_pairs,
    draw_dialogue,
)
from mdrive_sumo.negotiation.dialogue.vocabulary import AGREE, END, SAY, load_vocabulary
from mdrive_sumo.v2x.messages import Intention

VOCABULARY = load_vocabulary()
ARCHIVE = "dialogues-000000.npz"


@pytest.fixture(scope="module")
def samples() -> DialogueSamples:
    return build_synthetic_dialogues(VOCABULARY, 6, 0)


def test_fields_and_bounds_of_a_proposal_and_an_agreement() -> None:
    said = Dialogue(SAY, ("traffic 3",), "ABC", "B", "propose C>A>B stop: I wait", "p")
    agreed = Dialogue(AGREE, ("traffic 3",), "ABC", "B", "C>A>B keep faster stop 80", "p")
    samples = encode_dialogues(VOCABULARY, [said, agreed])
    assert samples.ranks[:, :4].tolist() == [[1, 2, 0, UNKNOWN]] * 2
    assert samples.actions[0, :3].tolist() == [UNKNOWN, Intention.STOP, UNKNOWN]
    assert samples.actions[1, :3].tolist() == [Intention.FASTER, Intention.STOP, Intention.KEEP]
    start, head, length = samples.answer_start[0], samples.head_end[0], samples.length[0]
    assert VOCABULARY.decode(samples.entries[0, start:head].tolist()) == "propose C>A>B stop"
    assert VOCABULARY.decode(samples.entries[0, head : length - 1].tolist()) == ": I wait"
    assert samples.entries[0, length - 1] == END and samples.head_end[1] == samples.length[1]


def test_made_up_dialogues_depend_on_seed_index_and_split_only() -> None:
    dialogue = draw_dialogue(VOCABULARY, 3, 0)
    assert draw_dialogue(VOCABULARY, 3, 0) == dialogue
    others = [draw_dialogue(VOCABULARY, 4, 0), draw_dialogue(VOCABULARY, 3, 1), draw_dialogue(VOCABULARY, 3, 0, "val")]
    assert dialogue not in others


@pytest.mark.parametrize("answer", ["propose A>B fly", "propose A>C keep", "propose A>B keep: [x]", "B>A keep keep 90"])
def test_an_answer_that_the_grammar_does_not_allow_is_no_sample(answer: str) -> None:
    with pytest.raises(ValueError, match="answer: expected one of the grammar"):
        encode_dialogues(VOCABULARY, [Dialogue(SAY, (), "AB", "A", answer, "p")])


def test_files_hold_what_was_written(samples: DialogueSamples, tmp_path: Path) -> None:
    pairs = build_synthetic_pairs(VOCABULARY, 3, 0)
    halves = [samples.take(np.arange(3)), samples.take(np.arange(3, 6))]
    write_dialogues(tmp_path, "train", halves, pairs)
    found = read_dialogues(tmp_path, VOCABULARY.digest)
    assert found.places == samples.places
    for name, values in samples.get_arrays().items():
        np.testing.assert_array_equal(found.get_arrays()[name], values)
    np.testing.assert_array_equal(read_pairs(tmp_path, VOCABULARY.digest).worse.ranks, pairs.worse.ranks)


def damage_arrays(path: Path, **changes: Any) -> None:
    arrays = read_arrays(path, "dialogues")
    for name, value in changes.items():
        if value is None:
            del arrays[name]
        else:
            arrays[name] = value
    write_arrays(path, arrays)


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"ranks": None}, "expected an array ranks, found none"),
        ({"places": np.arange(6)}, "places: expected names, found int64"),
        ({"entries": np.zeros((6, 512), np.int64)}, "entries: expected uint16 .6, 512., found int64"),
        ({"entries": np.zeros((6, 100), np.uint16)}, "entries: expected uint16 .6, 512., found uint16 .6, 100."),
        ({"entries": np.full((6, 512), 2048, np.uint16)}, "entries: expected numbers in their range"),
        ({"length": np.full(6, 513, np.int16)}, "length: expected numbers in their range, found others in row 0"),
        ({"answer_start": np.zeros(6, np.int16)}, "answer_start, head_end, length: expected numbers in their range"),
        ({"ranks": np.full((6, 8), 8, np.int8)}, "ranks: expected numbers in their range"),
        ({"actions": np.full((6, 8), 4, np.int8)}, "actions: expected numbers in their range"),
    ],
)
def test_arrays_of_another_kind_are_a_sentence(
    changes: dict[str, Any], expected: str, samples: DialogueSamples, tmp_path: Path
) -> None:
    write_dialogues(tmp_path, "train", [samples])
    damage_arrays(tmp_path / ARCHIVE, **changes)
    with pytest.raises(InputError, match=expected) as error:
        read_dialogues(tmp_path, VOCABULARY.digest)
    assert ARCHIVE in str(error.value) and "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        ({"format": "words"}, "expected the format 'mdrive-sumo dialogues 1', found 'words'"),
        ({"vocabulary": "ab"}, "expected dialogues in the vocabulary"),
        ({"split": "exam"}, "split: expected one of train, val, test, found 'exam'"),
        ({"shards": []}, "shards: expected the numbers of archives, found .]"),
        ({"shards": ["../secrets.npz"]}, "shards: expected the numbers of archives, found .'../secrets.npz'"),
        ({"shards": [9]}, "dialogues-000009.npz: expected an archive of dialogues, found"),
        ({"pairs": [-1]}, "pairs: expected the numbers of archives, found .-1]"),
        ({"pairs": []}, "expected pairs of better and worse answers, found none"),
    ],
)
def test_an_index_of_another_kind_is_a_sentence(
    change: dict[str, Any], expected: str, samples: DialogueSamples, tmp_path: Path
) -> None:
    path = write_dialogues(tmp_path, "train", [samples], build_synthetic_pairs(VOCABULARY, 2, 0))
    path.write_text(json.dumps(json.loads(path.read_text()) | change))
    with pytest.raises(InputError, match=expected):
        read_dialogues(tmp_path, VOCABULARY.digest)
        read_pairs(tmp_path, VOCABULARY.digest)


def test_missing_and_damaged_files_are_sentences(samples: DialogueSamples, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected the index of dialogues, found No such file"):
        read_dialogues(tmp_path, VOCABULARY.digest)
    write_dialogues(tmp_path, "train", [samples])
    (tmp_path / ARCHIVE).write_bytes(b"PK no archive")
    with pytest.raises(InputError, match="expected an archive of arrays, found a damaged one"):
        read_dialogues(tmp_path, VOCABULARY.digest)
    (tmp_path / INDEX_NAME).write_text("{")
    with pytest.raises(InputError, match="expected JSON, found an error"):
        read_dialogues(tmp_path, VOCABULARY.digest)


def test_pairs_have_equal_prompts(tmp_path: Path) -> None:
    pairs = build_synthetic_pairs(VOCABULARY, 3, 0)
    other = replace(pairs, worse=pairs.worse.take(np.array([1, 0, 2])))
    write_dialogues(tmp_path, "train", [pairs.better], other)
    with pytest.raises(InputError, match="expected pairs of answers to equal prompts, found other prompts"):
        read_pairs(tmp_path, VOCABULARY.digest)


def test_splits_share_no_place(samples: DialogueSamples) -> None:
    check_places_differ(samples, build_synthetic_dialogues(VOCABULARY, 6, 0, "val"))
    with pytest.raises(InputError, match="expected places without training, found 'made-up-train-0'"):
        check_places_differ(samples, samples)
    with pytest.raises(InputError, match="expected those of the vocabulary"):
        check_places_differ(samples, replace(samples, vocabulary="0" * 32))
