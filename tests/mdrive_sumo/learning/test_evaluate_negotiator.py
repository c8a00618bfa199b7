"""`learn evaluate-negotiator`: shares of right orders, actions and heads, by task and size of the group."""

import json
from pathlib import Path

import numpy as np
import pytest
from click.testing import CliRunner
from testing.tiny_negotiator import SHAPE, write_tiny_negotiator

from mdrive_sumo.cli import main
from mdrive_sumo.learning.dialogue.dialogue_files import write_dialogues
from mdrive_sumo.learning.dialogue.dialogue_samples import Dialogue, encode_dialogues
from mdrive_sumo.learning.dialogue.synthetic_dialogues import build_synthetic_dialogues
from mdrive_sumo.negotiation.dialogue.vocabulary import AGREE, ANSWER, SAY, load_vocabulary

pytest.importorskip("onnxruntime")
VOCABULARY = load_vocabulary()
TAUGHT = (
    Dialogue(SAY, (), "AB", "A", "propose B>A slower: B is nearest", "p"),
    Dialogue(SAY, (), "AB", "A", "accept B>A slower", "p"),
    Dialogue(SAY, (), "AB", "A", "propose B>A stop", "p"),
    Dialogue(SAY, (), "AB", "A", "propose A>B slower", "p"),
    Dialogue(AGREE, (), "ABC", "A", "A>B>C keep keep keep 100", "p"),
)


def write_network(folder: Path, text: str) -> Path:
    """A network that says a text, and of agreements the first letters and actions."""
    scores = np.zeros((SHAPE.vocabulary, SHAPE.vocabulary), np.float32)
    entries = [ANSWER, *VOCABULARY.encode(text)]
    scores[entries[:-1], entries[1:]] = 1.0
    return write_tiny_negotiator(folder, scores)


def test_shares_of_what_was_taught(tmp_path: Path) -> None:
    write_dialogues(tmp_path / "data", "test", [encode_dialogues(VOCABULARY, TAUGHT)])
    weights = write_network(tmp_path, "propose B>A slower")
    words = ["--weights", weights, "--data", tmp_path / "data", "--out", tmp_path / "scores.json"]
    ended = CliRunner().invoke(main, ["learn", "evaluate-negotiator", *map(str, words)])
    assert ended.exit_code == 0, ended.output
    said, agreed = json.loads((tmp_path / "scores.json").read_text())
    assert said == {"task": "say", "members": 2, "dialogues": 4, "order": 0.75, "actions": 0.5, "head": 0.25}
    assert (agreed["task"], agreed["members"], agreed["dialogues"]) == ("agree", 3, 1)
    assert "order and actions" in ended.output and "0.750" in ended.output


def test_mistakes_are_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    right, other = write_tiny_negotiator(tmp_path), write_tiny_negotiator(tmp_path / "other", vocabulary="0" * 32)
    write_dialogues(tmp_path / "data", "test", [build_synthetic_dialogues(VOCABULARY, 2, 0)])
    for weights, words, part in (
        (right, ("--data", tmp_path / "none"), "expected the index of dialogues, found No such file"),
        (other, ("--data", tmp_path / "data"), "expected those of the vocabulary"),
        (right, ("--data", tmp_path / "data", "--dialogues", 0), "'--dialogues'"),
    ):
        ended = CliRunner().invoke(main, ["learn", "evaluate-negotiator", "--weights", str(weights), *map(str, words)])
        assert ended.exit_code == 2 and part in " ".join(ended.output.split()), ended.output
