"""The packaged vocabulary is the one that its tool builds, and it has a piece for each word of dialogues."""

from mdrive_sumo.learning.dialogue.synthetic_dialogues import draw_dialogue
from mdrive_sumo.negotiation.dialogue.vocabulary import PACKAGED, format_vocabulary, load_vocabulary
from tools.build_vocabulary import build_vocabulary


def test_the_packaged_vocabulary_is_built_from_the_dialogues() -> None:
    assert format_vocabulary(build_vocabulary()) == PACKAGED.read_text("utf-8"), "run tools/build_vocabulary.py"


def test_words_of_dialogues_are_one_entry_each() -> None:
    text = draw_dialogue(0, 0).lines[1]
    assert len(load_vocabulary().encode(text)) < 2 * len(text.split())
