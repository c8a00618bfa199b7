"""How often exported weights of the negotiator answer what is taught, on dialogues of places that they never saw."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.learning.dialogue.dialogue_samples import UNKNOWN, DialogueSamples
from mdrive_sumo.negotiation.dialogue.answer_grammar import AnswerGrammar
from mdrive_sumo.negotiation.dialogue.answers import LETTERS, parse_agreement, parse_proposal
from mdrive_sumo.negotiation.dialogue.dialogue_decoder import DialogueDecoder
from mdrive_sumo.negotiation.dialogue.vocabulary import SAY


@dataclass(frozen=True, slots=True)
class AnswerScore:
    """Answers of one kind, for groups of one size."""

    task: str
    """"say" or "agree"."""
    members: int
    dialogues: int
    order: float
    """Share of the answers with the taught order of passing."""
    actions: float
    """Share with the taught order and the taught actions, of the speaker or of all."""
    head: float
    """Share with no other entry in the head."""


def write_answer(decoder: DialogueDecoder, samples: DialogueSamples, row: int, has_words: bool) -> list[int]:
    """Return the entries of a decoder's answer to the prompt of a dialogue."""
    prompt = samples.entries[row, : samples.answer_start[row]].tolist()
    letters = LETTERS[: count_members(samples, row)]
    return decoder.write(prompt, AnswerGrammar(decoder.entries, prompt[0], letters, has_words=has_words))


def count_members(samples: DialogueSamples, row: int) -> int:
    """Return the size of the group of a dialogue."""
    return int((samples.ranks[row] != UNKNOWN).sum())


def evaluate_decoder(decoder: DialogueDecoder, samples: DialogueSamples, rows: Sequence[int]) -> list[AnswerScore]:
    """Return how the answers to some dialogues agree with the taught ones, by task and size of the group."""
    found: dict[tuple[str, int], list[tuple[bool, bool, bool]]] = {}
    for row in rows:
        task = "say" if samples.entries[row, 0] == SAY else "agree"
        found.setdefault((task, count_members(samples, row)), []).append(_judge(decoder, samples, row, task))
    return [
        AnswerScore(task, members, len(marks), *np.mean(marks, axis=0).tolist())
        for (task, members), marks in sorted(found.items(), reverse=True)
    ]


def _judge(decoder: DialogueDecoder, samples: DialogueSamples, row: int, task: str) -> tuple[bool, bool, bool]:
    """Return whether order, order with actions, and the whole head of an answer are the taught ones."""
    entries, letters = write_answer(decoder, samples, row, has_words=False), LETTERS[: count_members(samples, row)]
    text = decoder.vocabulary.decode(entries)
    taught = {letter: int(action) for letter, action in zip(letters, samples.actions[row], strict=False)}
    if task == "say":
        proposal = parse_proposal(text, letters)
        (me,) = (letter for letter, action in taught.items() if action != UNKNOWN)
        order, actions = proposal.order, taught | {me: int(proposal.action)}
    else:
        agreement = parse_agreement(text, letters)
        order = agreement.order
        actions = {letter: int(action) for letter, action in agreement.action_by_member.items()}
    has_order = [order.index(letter) for letter in letters] == samples.ranks[row, : len(letters)].tolist()
    head = samples.entries[row, samples.answer_start[row] : samples.head_end[row]].tolist()
    return has_order, has_order and actions == taught, entries[: len(head)] == head
