"""Build the vocabulary of the negotiator from the dialogues that it is trained on.

    python tools/build_vocabulary.py          # writes mdrive_sumo/negotiation/dialogue/vocabulary.json

Until the grammars of wording are there, the dialogues are the made-up ones, and most entries stay free.
"""

from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.learning.dialogue.synthetic_dialogues import draw_dialogue
from mdrive_sumo.negotiation.dialogue.decoder_shape import NEGOTIATOR
from mdrive_sumo.negotiation.dialogue.vocabulary import (
    FIRST_MERGED,
    PACKAGED,
    DialogueVocabulary,
    format_vocabulary,
    learn_merges,
)

DIALOGUES = 2000
"""Read to count words; all words of the made-up ones are among the first hundreds."""


def build_vocabulary() -> DialogueVocabulary:
    """Return the vocabulary; equal dialogues give equal ones."""
    dialogues = [draw_dialogue(0, i) for i in range(DIALOGUES)]
    texts = [text for dialogue in dialogues for text in (*dialogue.lines, dialogue.answer)]
    return DialogueVocabulary(learn_merges(texts, NEGOTIATOR.vocabulary - FIRST_MERGED))


if __name__ == "__main__":
    write_text(PACKAGED, format_vocabulary(build_vocabulary()))
