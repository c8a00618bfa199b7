"""What writes the answers of a conversation: the network, and stand-ins for it that need no weights."""

from dataclasses import dataclass
from itertools import count
from typing import Protocol

from mdrive_sumo.core.seeding import draw_first_uniform
from mdrive_sumo.negotiation.dialogue.answer_grammar import AnswerEntries, AnswerGrammar
from mdrive_sumo.negotiation.dialogue.answers import (
    Agreement,
    OrderProposal,
    format_agreement,
    format_proposal,
)
from mdrive_sumo.negotiation.dialogue.dialogue_decoder import DialogueAnswer, DialogueDecoder
from mdrive_sumo.negotiation.dialogue.dialogue_view import DialogueView
from mdrive_sumo.negotiation.dialogue.vocabulary import END, SAY, DialogueVocabulary
from mdrive_sumo.negotiation.intention import replace_slow_keep
from mdrive_sumo.v2x.messages import Intention


@dataclass(frozen=True, slots=True)
class AnswerRequest:
    """What is asked of a writer."""

    task: int
    """SAY or AGREE."""
    view: DialogueView
    """What the speaker knows."""
    lines: tuple[str, ...]
    """The same and what was said, as the network reads it."""
    id_bytes: tuple[int, ...]
    """See `AnswerGrammar`."""
    max_bytes: int
    """Of the answer, with station ids in place of letters."""


class AnswerWriter(Protocol):
    """Writes answers of the grammar of `AnswerGrammar`."""

    def write(self, request: AnswerRequest) -> DialogueAnswer:
        """Return the answer. Raises ValueError for a request that cannot be answered."""
        ...


class NetworkWriter:
    """The project's own language model."""

    def __init__(self, decoder: DialogueDecoder, has_words: bool = True) -> None:
        """has_words: False: it says the heads of its messages only."""
        self._decoder, self._has_words = decoder, has_words

    def write(self, request: AnswerRequest) -> DialogueAnswer:
        """Implement `AnswerWriter`."""
        return self._decoder.answer(
            request.task,
            request.lines,
            request.view.letters,
            request.id_bytes,
            request.max_bytes,
            self._has_words,
        )


class FormulaWriter:
    """Heads without words: all pass in the order in which they enter the areas that they share, those behind slower."""

    def write(self, request: AnswerRequest) -> DialogueAnswer:
        """Implement `AnswerWriter`."""
        view = request.view
        order = _find_order(view)
        actions = dict.fromkeys(order, Intention.SLOWER)
        actions[order[0]] = replace_slow_keep(Intention.KEEP, view.get_member(order[0]).speed)
        if request.task == SAY:
            return DialogueAnswer(format_proposal(OrderProposal("propose", order, actions[view.me])), 0, 0)
        return DialogueAnswer(format_agreement(Agreement(order, actions, 1.0)), 0, 0)


def _find_order(view: DialogueView) -> tuple[str, ...]:
    """Return the letters by the times of entry, each behind the member that it follows; ties by letter."""
    entries = {one.letter: one.zone_s[0] if one.zone_s is not None else float("inf") for one in view.members}
    order: list[str] = []
    waiting = sorted(entries, key=lambda letter: (entries[letter], letter))
    while waiting:
        free = [letter for letter in waiting if view.get_member(letter).follows not in waiting]
        order.append((free or waiting)[0])
        waiting.remove(order[-1])
    return tuple(order)


class RandomWriter:
    """Any answer of the grammar, by a seed: what talk is worth is measured against this twin."""

    def __init__(self, vocabulary: DialogueVocabulary, seed: int, has_words: bool = True) -> None:
        self._entries, self._vocabulary = AnswerEntries.find(vocabulary), vocabulary
        self._seed, self._has_words = seed, has_words
        self._ordinals = count()

    def write(self, request: AnswerRequest) -> DialogueAnswer:
        """Implement `AnswerWriter`."""
        letters, ordinal = request.view.letters, next(self._ordinals)
        about = request.task, letters, request.id_bytes, request.max_bytes
        grammar = AnswerGrammar(self._entries, *about, self._has_words and request.task == SAY)
        written: list[int] = []
        while not grammar.is_complete:
            draw = draw_first_uniform(self._seed, "random-talk", ordinal, len(written))
            written.append(int(grammar.allowed[int(draw * len(grammar.allowed))]))
            grammar.advance(written[-1])
        assert written[-1] == END, "every answer of the grammar has an end"
        return DialogueAnswer(self._vocabulary.decode(written), 0, len(written))
