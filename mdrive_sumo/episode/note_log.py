"""The notes of an episode, limited in number, kinds and size: a program that is not trusted writes them."""

from collections.abc import Sequence

from mdrive_sumo.contract import Note
from mdrive_sumo.episode.episode import NoteRecord

MAX_KINDS = 32
"""Kinds of notes in an episode. The baselines use four."""
MAX_NOTES = 20_000
"""Notes in an episode: two in every tick of eight CAVs for a minute."""
MAX_CHARACTERS = 8 * 2**20
"""Characters in all notes of an episode; an exchange with a language model has a few thousand."""


class NoteLog:
    """Collects notes; those beyond a limit are counted and dropped. The same notes are kept in every run."""

    def __init__(self) -> None:
        self._records: list[NoteRecord] = []
        self._kinds: set[str] = set()
        self._characters = 0
        self.dropped = 0
        """Notes that were not kept."""

    @property
    def records(self) -> tuple[NoteRecord, ...]:
        """The notes that were kept, in order."""
        return tuple(self._records)

    def add(self, tick: int, ego: str, notes: Sequence[Note]) -> None:
        """Add the notes of one CAV."""
        for note in notes:
            if self._has_room(note):
                self._kinds.add(note.kind)
                self._characters += len(note.text)
                self._records.append(NoteRecord(tick, ego, note))
            else:
                self.dropped += 1

    def _has_room(self, note: Note) -> bool:
        return (
            len(self._records) < MAX_NOTES
            and self._characters + len(note.text) <= MAX_CHARACTERS
            and (note.kind in self._kinds or len(self._kinds) < MAX_KINDS)
        )
