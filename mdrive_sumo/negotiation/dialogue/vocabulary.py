"""DialogueVocabulary: the 2 048 entries in which the negotiator's network reads and writes.

Control entries, the words of answers, letters of members and numbers have entries of their own. All other text is
split into words, and these into pieces by byte pair encoding (Sennrich et al. 2016), so any text has an encoding.
"""

import hashlib
import json
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from functools import lru_cache
from itertools import pairwise
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import read_json_file
from mdrive_sumo.negotiation.dialogue.answers import ACTION_WORDS, CONSENSUS_STEPS, LETTERS, STANCES
from mdrive_sumo.negotiation.dialogue.decoder_shape import NEGOTIATOR

FORMAT = "mdrive-sumo dialogue vocabulary 1"
PACKAGED = Path(__file__).parent / "vocabulary.json"
CONTROLS = ("<pad>", "<end>", "<say>", "<agree>", "<line>", "<answer>")
"""Never part of a text: what another station sends cannot contain them."""
PAD, END, SAY, AGREE, LINE, ANSWER = range(len(CONTROLS))
_FIXED_WORDS = (
    *STANCES,
    *(f" {stance}" for stance in STANCES),
    *(f" {word}" for word in ACTION_WORDS.values()),
    *LETTERS,
    *(f" {letter}" for letter in LETTERS),
    ">",
    ":",
    *(str(number) for number in range(100)),
    *(f" {number}" for number in range(100)),
    *(f" {percent}" for percent in CONSENSUS_STEPS if percent > 99),
    *(f".{digit}" for digit in range(10)),
)
FIRST_BYTE = len(CONTROLS) + len(_FIXED_WORDS)
FIRST_MERGED = FIRST_BYTE + 256
_PART = re.compile(
    rf" ?(?<![A-Za-z])[{LETTERS}](?![A-Za-z])|(?<=\d)\.\d(?!\d)| ?100(?!\d)| ?\d\d?"
    r"| ?[A-Za-z']+|[>:]| ?[^\w\s>:]+|\s|\w"
)
"""A fixed word, a number, a word, punctuation or a single character; a blank belongs to what follows it."""
CACHED_PARTS = 16_384
"""Encoded words that are kept."""
Merge = tuple[bytes, bytes]


class DialogueVocabulary:
    """Text to entries and back."""

    def __init__(self, merges: Sequence[Merge]) -> None:
        """merges: pairs of pieces that become one, the first ones first. Raises ValueError for unusable ones."""
        if len(merges) > NEGOTIATOR.vocabulary - FIRST_MERGED:
            raise ValueError(f"expected at most {NEGOTIATOR.vocabulary - FIRST_MERGED} merges, found {len(merges)}")
        self.merges = tuple(merges)
        self._texts = [*CONTROLS, *_FIXED_WORDS]
        pieces = [bytes((byte,)) for byte in range(256)]
        known = set(pieces)
        for left, right in self.merges:
            if left not in known or right not in known or left + right in known:
                raise ValueError(f"merge: expected two pieces that give a new one, found {left!r:.40}, {right!r:.40}")
            known.add(left + right)
            pieces.append(left + right)
        self.pieces: tuple[bytes, ...] = (
            *(b"" for _ in CONTROLS),
            *(word.encode() for word in _FIXED_WORDS),
            *pieces,
            *(b"" for _ in range(NEGOTIATOR.vocabulary - FIRST_MERGED - len(self.merges))),
        )
        """Bytes of each entry; none of control entries and of entries that a small vocabulary leaves free."""
        self._entry_by_word = {word: len(CONTROLS) + i for i, word in enumerate(_FIXED_WORDS)}
        self._entry_by_piece = {piece: FIRST_BYTE + i for i, piece in enumerate(pieces)}
        self._rank_by_merge = {merge: rank for rank, merge in enumerate(self.merges)}
        self._encode_part = lru_cache(CACHED_PARTS)(self._encode_new_part)

    @property
    def digest(self) -> str:
        """Digest of all entries: weights and samples belong to one vocabulary."""
        content = json.dumps([piece.hex() for piece in self.pieces]).encode()
        return hashlib.blake2b(content, digest_size=16).hexdigest()

    def find_entry(self, word: str) -> int:
        """Return the entry of a word that has one of its own. Raises KeyError."""
        return self._entry_by_word[word]

    def encode(self, text: str) -> list[int]:
        """Return the entries of a text, without control entries whatever it contains."""
        return [entry for part in split_parts(text) for entry in self._encode_part(part)]

    def encode_prompt(self, task: int, lines: Iterable[str]) -> list[int]:
        """Return the entries of a prompt. task: SAY or AGREE."""
        entries = [task]
        for line in lines:
            entries += self.encode(line)
            entries.append(LINE)
        return [*entries, ANSWER]

    def decode(self, entries: Iterable[int]) -> str:
        """Return the text of entries; control entries give nothing, bytes that are no UTF-8 a replacement."""
        return b"".join(self.pieces[entry] for entry in entries).decode("utf-8", "replace")

    def _encode_new_part(self, part: str) -> tuple[int, ...]:
        entry = self._entry_by_word.get(part)
        if entry is not None:
            return (entry,)
        pieces = [bytes((byte,)) for byte in part.encode("utf-8", "replace")]
        while len(pieces) > 1:
            ranks = [self._rank_by_merge.get(pair, len(self.merges)) for pair in pairwise(pieces)]
            rank = min(ranks)
            if rank == len(self.merges):
                break
            pieces = merge_pair(pieces, self.merges[rank])
        return tuple(self._entry_by_piece[piece] for piece in pieces)


def split_parts(text: str) -> list[str]:
    """Return the parts of a text, which pieces never cross; joined they are the text."""
    return _PART.findall(text)


def merge_pair(pieces: Sequence[bytes], pair: Merge) -> list[bytes]:
    """Return the pieces with each occurrence of the pair, from the left, as one piece."""
    merged: list[bytes] = []
    for piece in pieces:
        if merged and (merged[-1], piece) == pair:
            merged[-1] += piece
        else:
            merged.append(piece)
    return merged


def learn_merges(texts: Iterable[str], count: int) -> list[Merge]:
    """Return up to `count` merges of the most frequent neighbours; ties go to the pair that sorts first."""
    fixed = set(_FIXED_WORDS)
    parts = Counter(part for text in texts for part in split_parts(text) if part not in fixed)
    words = [([bytes((byte,)) for byte in part.encode()], number) for part, number in sorted(parts.items())]
    merges: list[Merge] = []
    known: set[bytes] = set()
    while len(merges) < count:
        pairs: Counter[Merge] = Counter()
        for pieces, number in words:
            for pair in pairwise(pieces):
                pairs[pair] += number
        usable = [(-number, pair) for pair, number in pairs.items() if pair[0] + pair[1] not in known]
        if not usable:
            break
        best = min(usable)[1]
        merges.append(best)
        known.add(best[0] + best[1])
        words = [(merge_pair(pieces, best), number) for pieces, number in words]
    return merges


def format_vocabulary(vocabulary: DialogueVocabulary) -> str:
    """Return the JSON text that `load_vocabulary` reads; bytes are written as Latin-1."""
    merges = [[left.decode("latin-1"), right.decode("latin-1")] for left, right in vocabulary.merges]
    return json.dumps({"format": FORMAT, "merges": merges}, separators=(",", ":")) + "\n"


@lru_cache(maxsize=2)
def load_vocabulary(path: Path = PACKAGED) -> DialogueVocabulary:
    """Return a vocabulary. Raises InputError with one sentence for a file that holds none."""
    content = read_json_file(path, "a vocabulary of dialogues", FORMAT)
    try:
        merges = [(str(left).encode("latin-1"), str(right).encode("latin-1")) for left, right in content["merges"]]
        return DialogueVocabulary(merges)
    except (KeyError, TypeError, ValueError) as error:
        raise InputError(f"{path}: merges: expected pairs of pieces, found {error!s:.120}") from None
