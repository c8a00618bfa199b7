"""The packaged vocabulary is the one that its tool builds, and it has a piece for each word of dialogues."""

import re

import pytest

from mdrive_sumo.learning.dialogue.synthetic_dialogues import draw_dialogue
from mdrive_sumo.learning.dialogue.wording import list_words
from mdrive_sumo.negotiation.dialogue.vocabulary import PACKAGED, format_vocabulary, load_vocabulary
from tools.build_vocabulary import build_vocabulary


@pytest.mark.slow
def test_the_packaged_vocabulary_is_built_from_the_dialogues() -> None:
    assert format_vocabulary(build_vocabulary()) == PACKAGED.read_text("utf-8"), "run python -m tools.build_vocabulary"


def test_words_of_dialogues_are_one_entry_each() -> None:
    vocabulary = load_vocabulary()
    for word in {word for text in list_words() for word in re.findall(r"[a-z]{2,}", text)}:
        assert len(vocabulary.encode(f" {word}")) <= 1, word
    text = " ".join(draw_dialogue(vocabulary, 0, 0).lines)
    assert len(vocabulary.encode(text)) < 2 * len(text.split())
