"""DialogueSamples: prompts with their answers as arrays, and pairs of answers of which one drives better."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.negotiation.dialogue.answer_grammar import AnswerEntries, AnswerGrammar
from mdrive_sumo.negotiation.dialogue.answers import LETTERS, MAX_MEMBERS, parse_agreement, parse_proposal
from mdrive_sumo.negotiation.dialogue.decoder_shape import NEGOTIATOR
from mdrive_sumo.negotiation.dialogue.vocabulary import END, SAY, DialogueVocabulary
from mdrive_sumo.v2x.messages import Intention

UNKNOWN = -1
"""In `ranks` and `actions`: not a member, or not said."""


@dataclass(frozen=True, slots=True)
class Dialogue:
    """One request to the model and the answer that it should give."""

    task: int
    """SAY or AGREE."""
    lines: tuple[str, ...]
    letters: str
    """Of all members."""
    me: str
    """Letter of the speaker; any member for AGREE."""
    answer: str
    place: str
    """Name of the place; splits have none in common."""


@dataclass(frozen=True, slots=True)
class DialogueSamples:
    """N dialogues of one vocabulary."""

    vocabulary: str
    """Its digest."""
    places: tuple[str, ...]
    entries: npt.NDArray[np.uint16]
    """(N, T) prompt and answer, then `PAD`."""
    answer_start: npt.NDArray[np.int16]
    """(N,) where the answer begins."""
    head_end: npt.NDArray[np.int16]
    """(N,) where the words of the answer begin, or it ends."""
    length: npt.NDArray[np.int16]
    """(N,) entries of prompt and answer."""
    ranks: npt.NDArray[np.int8]
    """(N, MAX_MEMBERS) place of each letter in the order of passing, or UNKNOWN."""
    actions: npt.NDArray[np.int8]
    """(N, MAX_MEMBERS) action of each letter, or UNKNOWN."""

    def __len__(self) -> int:
        return len(self.entries)

    def get_arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return the arrays by name."""
        return {each.name: getattr(self, each.name) for each in fields(self)[2:]}

    def take(self, rows: npt.NDArray[np.int64]) -> "DialogueSamples":
        """Return the dialogues of some rows."""
        arrays = {name: values[rows] for name, values in self.get_arrays().items()}
        return DialogueSamples(self.vocabulary, tuple(self.places[row] for row in rows.tolist()), **arrays)


@dataclass(frozen=True, slots=True)
class DialoguePairs:
    """Pairs of answers to the same prompts."""

    better: DialogueSamples
    worse: DialogueSamples
    """Its answer has the worse outcome in the simulation."""

    def __len__(self) -> int:
        return len(self.better)


def encode_dialogues(vocabulary: DialogueVocabulary, dialogues: Sequence[Dialogue]) -> DialogueSamples:
    """Return dialogues as arrays. Raises ValueError for an answer that the grammar does not allow, or a long one."""
    count = len(dialogues)
    entries = np.zeros((count, NEGOTIATOR.context), np.uint16)
    answer_start, head_end, length = (np.zeros(count, np.int16) for _ in range(3))
    ranks = np.full((count, MAX_MEMBERS), UNKNOWN, np.int8)
    actions = np.full((count, MAX_MEMBERS), UNKNOWN, np.int8)
    known = AnswerEntries.find(vocabulary)
    for i, dialogue in enumerate(dialogues):
        prompt = vocabulary.encode_prompt(dialogue.task, dialogue.lines)
        answer = [*vocabulary.encode(dialogue.answer), END]
        _check_answer(known, dialogue, answer)
        whole = prompt + answer
        if len(whole) > NEGOTIATOR.context:
            raise ValueError(f"dialogue {i}: expected at most {NEGOTIATOR.context} entries, found {len(whole)}")
        entries[i, : len(whole)] = whole
        head = answer.index(known.colon) if known.colon in answer else len(answer)
        answer_start[i] = len(prompt)
        head_end[i] = len(prompt) + head
        length[i] = len(whole)
        order, by_member = _read_fields(dialogue)
        for rank, letter in enumerate(order):
            ranks[i, LETTERS.index(letter)] = rank
        for letter, action in by_member.items():
            actions[i, LETTERS.index(letter)] = int(action)
    places = tuple(dialogue.place for dialogue in dialogues)
    return DialogueSamples(vocabulary.digest, places, entries, answer_start, head_end, length, ranks, actions)


def _check_answer(known: AnswerEntries, dialogue: Dialogue, answer: Sequence[int]) -> None:
    grammar = AnswerGrammar(known, dialogue.task, dialogue.letters)
    for entry in answer:
        if entry not in grammar.allowed:
            raise ValueError(f"answer: expected one of the grammar, found {dialogue.answer!r:.100}")
        grammar.advance(entry)


def _read_fields(dialogue: Dialogue) -> tuple[tuple[str, ...], Mapping[str, Intention]]:
    """Return the order and the actions that an answer states."""
    if dialogue.task == SAY:
        proposal = parse_proposal(dialogue.answer, dialogue.letters)
        return proposal.order, {dialogue.me: proposal.action}
    agreement = parse_agreement(dialogue.answer, dialogue.letters)
    return agreement.order, agreement.action_by_member


def check_places_differ(train: DialogueSamples, judged: DialogueSamples) -> None:
    """Raise InputError if two splits share a place, or are of different vocabularies."""
    if train.vocabulary != judged.vocabulary:
        raise InputError(
            f"dialogues for validation: expected those of the vocabulary {train.vocabulary[:8]}..., found"
            f" {judged.vocabulary[:8]}..."
        )
    shared = sorted(set(train.places) & set(judged.places))
    if shared:
        raise InputError(f"dialogues for validation: expected places without training, found {shared[0]!r:.60}")
