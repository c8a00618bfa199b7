"""AnswerGrammar: which entries may come next in an answer, so that every answer can be read whatever the network says.

    proposal  = stance order action [":" words] end       order     = letter {">" letter}, every member once
    agreement = order {action} consensus end               action    = "stop" | "slower" | "keep" | "faster"

Words are pieces of lower-case text, numbers and letters of members, within the bytes of a message.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from mdrive_sumo.negotiation.dialogue.answers import (
    ACTION_WORDS,
    CONSENSUS_STEPS,
    LETTERS,
    MAX_MEMBERS,
    MAX_MESSAGE_BYTES,
    STANCES,
)
from mdrive_sumo.negotiation.dialogue.vocabulary import END, SAY, DialogueVocabulary

MAX_WORD_ENTRIES = 40
"""Of one message: 1.5 ms each on one core."""
HEAD_ENTRIES = 3 * MAX_MEMBERS + 4
"""Most entries of an answer without its words."""
MAX_ANSWER_ENTRIES = HEAD_ENTRIES + MAX_WORD_ENTRIES
_WORD_PIECE = re.compile(r"(?=.*[^ ]|.$)[ a-zI0-9.,;'!?()%-]+")
"""Lower case, so that the letters of members stand out; "I" is the speaker."""
Entries = npt.NDArray[np.int64]


@dataclass(frozen=True)
class AnswerEntries:
    """The entries of a vocabulary by what they are in an answer."""

    stances: Entries
    actions: Entries
    consensus: Entries
    letters: Mapping[str, int]
    """First of an agreement, or after ">"."""
    spaced_letters: Mapping[str, int]
    """First of a proposal's order."""
    arrow: int
    colon: int
    pieces: Entries
    """Of words, without letters of members."""
    size: npt.NDArray[np.int64]
    """Bytes of each entry of the vocabulary."""

    @classmethod
    def find(cls, vocabulary: DialogueVocabulary) -> "AnswerEntries":
        """Return the entries of a vocabulary."""
        find = vocabulary.find_entry
        is_letter = {find(form) for letter in LETTERS for form in (letter, f" {letter}")}
        texts = [piece.decode("latin-1") for piece in vocabulary.pieces]
        pieces = [i for i, text in enumerate(texts) if i not in is_letter and _WORD_PIECE.fullmatch(text)]
        return cls(
            stances=np.array([find(stance) for stance in STANCES]),
            actions=np.array([find(f" {word}") for word in ACTION_WORDS.values()]),
            consensus=np.array([find(f" {percent}") for percent in CONSENSUS_STEPS]),
            letters={letter: find(letter) for letter in LETTERS},
            spaced_letters={letter: find(f" {letter}") for letter in LETTERS},
            arrow=find(">"),
            colon=find(":"),
            pieces=np.array(pieces),
            size=np.array([len(piece) for piece in vocabulary.pieces]),
        )


class AnswerGrammar:
    """The state of one answer while it is written."""

    def __init__(
        self,
        entries: AnswerEntries,
        task: int,
        letters: str,
        id_bytes: Sequence[int] = (),
        max_bytes: int = MAX_MESSAGE_BYTES,
        has_words: bool = True,
    ) -> None:
        """task: SAY or AGREE. letters: of all members. id_bytes: bytes of what is sent in place of each letter; ():
        the letters are sent. has_words: False: a proposal ends with its head."""
        self._entries, self._letters, self._has_words = entries, letters, has_words
        self._extra_bytes = {
            entry: size - 1
            for letter, size in zip(letters, id_bytes, strict=bool(id_bytes))
            for entry in (entries.letters[letter], entries.spaced_letters[letter])
        }
        members = [entries.letters[letter] for letter in letters]
        spaced = [entries.spaced_letters[letter] for letter in letters]
        self._word_entries = np.concatenate((entries.pieces, members, spaced)).astype(np.int64)
        self._word_bytes = np.array([self._count_bytes(entry) for entry in self._word_entries.tolist()])
        self._bytes_left = max_bytes
        self._steps = self._write_proposal() if task == SAY else self._write_agreement()
        self._chosen = -1
        self.allowed: Entries = next(self._steps)
        """Entries that may come next, sorted; none when the answer is complete."""

    @property
    def is_complete(self) -> bool:
        """Whether the answer has ended."""
        return not len(self.allowed)

    def advance(self, entry: int) -> None:
        """Take the next entry of the answer. Raises ValueError for one that is not allowed."""
        if entry not in self.allowed:
            raise ValueError(f"entry {entry}: expected one of {len(self.allowed)} entries of the grammar")
        self._chosen = entry
        self._bytes_left -= self._count_bytes(entry)
        self.allowed = next(self._steps)

    def _count_bytes(self, entry: int) -> int:
        return int(self._entries.size[entry]) + self._extra_bytes.get(entry, 0)

    def _write_proposal(self) -> Iterator[Entries]:
        yield self._entries.stances
        yield from self._write_order(self._entries.spaced_letters)
        yield self._entries.actions
        if self._has_words and self._bytes_left > 1:
            yield np.sort((END, self._entries.colon), kind="stable")
            yield from self._write_words() if self._chosen != END else ()
        else:
            yield np.array((END,))
        yield np.array((), dtype=np.int64)

    def _write_words(self) -> Iterator[Entries]:
        """Allow at least one piece after the colon, if one fits, then the end at any time."""
        for number in range(MAX_WORD_ENTRIES):
            fitting = self._word_entries[self._word_bytes <= self._bytes_left]
            if not len(fitting):
                break
            yield np.sort(fitting if not number else np.append(fitting, END), kind="stable")
            if self._chosen == END:
                return
        yield np.array((END,))

    def _write_agreement(self) -> Iterator[Entries]:
        yield from self._write_order(self._entries.letters)
        for _ in self._letters:
            yield self._entries.actions
        yield self._entries.consensus
        yield np.array((END,))
        yield np.array((), dtype=np.int64)

    def _write_order(self, first_letters: Mapping[str, int]) -> Iterator[Entries]:
        left = list(self._letters)
        letters = first_letters
        while left:
            yield np.sort([letters[letter] for letter in left], kind="stable")
            left = [letter for letter in left if letters[letter] != self._chosen]
            letters = self._entries.letters
            if left:
                yield np.array((self._entries.arrow,))
