"""Build the vocabulary of the negotiator from the words of its dialogues.

    python -m tools.build_vocabulary          # writes mdrive_sumo/negotiation/dialogue/vocabulary.json

The dialogues are about made-up situations: prompts and grammars of wording are the same as in real ones, and no
simulation is needed. Weights and samples of another vocabulary are of no use.
"""

import click

from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.learning.dialogue.synthetic_dialogues import draw_dialogue
from mdrive_sumo.learning.dialogue.wording import list_words
from mdrive_sumo.negotiation.dialogue.decoder_shape import NEGOTIATOR
from mdrive_sumo.negotiation.dialogue.vocabulary import (
    FIRST_MERGED,
    PACKAGED,
    DialogueVocabulary,
    format_vocabulary,
    learn_merges,
)
from tools.tool_command import HELP, ToolCommand, dry_run_option

DIALOGUES = 700
"""Read to count words."""
ROUNDS = 2
"""The first vocabulary has no merges: prompts that are too long in it lose lines, those of the second do not."""


def build_vocabulary() -> DialogueVocabulary:
    """Return the vocabulary; equal dialogues give equal ones."""
    vocabulary = DialogueVocabulary(())
    for _ in range(ROUNDS):
        dialogues = [draw_dialogue(vocabulary, 0, i) for i in range(DIALOGUES)]
        texts = [text for dialogue in dialogues for text in (*dialogue.lines, dialogue.answer)]
        merges = learn_merges([*texts, *list_words()], NEGOTIATOR.vocabulary - FIRST_MERGED)
        vocabulary = DialogueVocabulary(merges)
    return vocabulary


@click.command(cls=ToolCommand, context_settings=HELP)
@dry_run_option
def main(dry_run: bool) -> None:
    """Build the vocabulary of the negotiator from the words of its dialogues."""
    built = format_vocabulary(build_vocabulary())
    is_changed = built != PACKAGED.read_text("utf-8")
    if is_changed and not dry_run:
        write_text(PACKAGED, built)
    echo(f"{PACKAGED}: {('would change' if dry_run else 'changed') if is_changed else 'is as built'}")


if __name__ == "__main__":
    main()
