"""Notes of an episode are limited in kinds, number and size, and what is dropped is counted and shown."""

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from testing.viewer_crossing import record

from mdrive_sumo.contract import DRIVER, EXCHANGE, REASON, Message, Note
from mdrive_sumo.episode import load_episode, recorder, save_episode
from mdrive_sumo.episode.recorder import (
    MAX_CHARACTERS,
    MAX_DRIVER_NOTE,
    MAX_DRIVER_NOTES,
    MAX_KINDS,
    MAX_NOTES,
    NoteLog,
)
from mdrive_sumo.scoring import scenario_score
from mdrive_sumo.v2x.channel import DeliveryStatus, SentMessage
from mdrive_sumo.v2x.message_counts import MAX_COUNTED_TYPES, OTHER, count_exchanged

NOTES = st.lists(st.builds(Note, st.sampled_from("abcdef"), st.text(max_size=20)), max_size=60)


@given(NOTES)
def test_what_is_kept_is_within_the_limits_and_nothing_else_is_dropped(notes: list[Note]) -> None:
    with pytest.MonkeyPatch.context() as patch:
        for name, value in (("MAX_KINDS", 3), ("MAX_NOTES", 20), ("MAX_CHARACTERS", 100)):
            patch.setattr(recorder, name, value)
        log = NoteLog()
        for tick, note in enumerate(notes):
            log.add(tick, "a", (note,))
    kept = [record.note for record in log.records]
    assert len(kept) + log.dropped == len(notes)
    assert len(kept) <= 20 and len({note.kind for note in kept}) <= 3 and sum(len(note.text) for note in kept) <= 100
    if len(notes) <= 20 and len({note.kind for note in notes}) <= 3 and sum(len(note.text) for note in notes) <= 100:
        assert kept == notes


@pytest.mark.slow
def test_an_episode_of_an_attacker_is_small() -> None:
    """As found: 1500 kinds a tick made a result of 17 MB."""
    log = NoteLog()
    for tick in range(40):
        log.add(tick, "a", [Note(f"{tick}-{n}", "x") for n in range(1500)])
    assert len({record.note.kind for record in log.records}) == MAX_KINDS == len(log.records)
    log = NoteLog()
    log.add(0, "a", [Note("a", "")] * (MAX_NOTES + 5))
    assert (len(log.records), log.dropped) == (MAX_NOTES, 5)
    log = NoteLog()
    log.add(0, "a", [Note("a", "x" * (MAX_CHARACTERS - 1)), Note("a", "xx"), Note("a", "x")])
    assert ([len(record.note.text) for record in log.records], log.dropped) == ([MAX_CHARACTERS - 1, 1], 1)


def test_reasons_leave_room_for_other_notes() -> None:
    log = NoteLog()
    log.add(0, "a", [Note(REASON, "")] * MAX_NOTES + [Note(EXCHANGE, "")] * 5)
    assert [record.note.kind for record in log.records] == [REASON] * (MAX_NOTES // 2) + [EXCHANGE] * 5
    log, half = NoteLog(), MAX_CHARACTERS // 2
    log.add(0, "a", [Note(REASON, "x" * half), Note(REASON, "x"), Note(EXCHANGE, "x" * half)])
    assert ([record.note.kind for record in log.records], log.dropped) == ([REASON, EXCHANGE], 1)


def test_drivers_always_find_room_but_not_without_end() -> None:
    """Without the note of a driver a take cannot be driven again, whatever agents have written before."""
    log = NoteLog()
    full = [Note("a", "x" * (MAX_CHARACTERS // MAX_NOTES + 1))] * MAX_NOTES
    log.add(0, "a", [*full, *(Note(f"k{n}", "") for n in range(MAX_KINDS)), Note(DRIVER, "{}")])
    assert log.records[-1].note.kind == DRIVER
    log = NoteLog()
    log.add(0, "a", [Note(DRIVER, "")] * (MAX_DRIVER_NOTES + MAX_NOTES + 5) + [Note("a", "")])
    assert (len(log.records), log.dropped) == (MAX_DRIVER_NOTES + MAX_NOTES, 6)
    log = NoteLog()
    log.add(0, "a", [*([Note("a", "")] * MAX_NOTES), Note(DRIVER, "x" * (MAX_DRIVER_NOTE + 1))])
    assert log.dropped == 1


def test_dropped_notes_are_recorded_and_counted(tmp_path: Path) -> None:
    episode = replace(record(ticks=3), dropped_notes=7)
    save_episode(episode, tmp_path / "e.npz")
    assert load_episode(tmp_path / "e.npz").dropped_notes == episode.dropped_notes
    assert scenario_score._count_notes(episode) == {scenario_score.DROPPED: episode.dropped_notes}


def test_types_of_messages_are_limited_too() -> None:
    """The same attack with messages in place of notes."""
    sent = [
        SentMessage(Message(f"t{n}", b"", "a", n), {"b": (DeliveryStatus.DELIVERED, n + 1)})
        for n in [*range(100), *range(10)]
    ]
    counts = count_exchanged(sent, ("a", "b"))
    assert len(counts) == MAX_COUNTED_TYPES + 1 and counts[OTHER] == 100 - MAX_COUNTED_TYPES
    assert counts["t3"] == 2 and sum(counts.values()) == 110
