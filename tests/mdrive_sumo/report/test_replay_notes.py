"""Notes come from agents: whatever their text is, the replay page shows it."""

import json
from types import SimpleNamespace
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mdrive_sumo.contract import EXCHANGE, REASON, Cause, Note, Reason
from mdrive_sumo.episode import NoteRecord
from mdrive_sumo.report.replay_notes import MAX_CHARS, list_notes


def shown(kind: str, text: str) -> tuple[str, str]:
    episode: Any = SimpleNamespace(
        notes=[NoteRecord(1, "0", Note(kind, text))], restore_names=str, restore_name=str, ids=()
    )
    ((tick, ego, _, text, details),) = list_notes(episode)
    assert (tick, ego) == (1, "0")
    assert max(len(text), len(details)) <= MAX_CHARS
    return text, details


DEEP = {
    "brackets": "[" * 100_000,
    "closed": '{"a":' * 100_000 + "1" + "}" * 100_000,
    "deep": '{"a":' * 700 + "1" + "}" * 700,
}


@pytest.mark.parametrize("name", DEEP)
@pytest.mark.parametrize("kind", ["plan", EXCHANGE])
def test_a_note_nested_without_end_is_shown_as_text(kind: str, name: str) -> None:
    text, _ = shown(kind, DEEP[name])
    assert text[:100] in (DEEP[name][:100], "") or text.startswith("a: a a a")


JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4),
    lambda parts: (
        st.lists(parts, max_size=3)
        | st.dictionaries(st.sampled_from(["error", "answer", "request", "messages", "content"]), parts, max_size=3)
    ),
    max_leaves=8,
)


@given(JSON)
@settings(max_examples=40)
def test_any_json_is_shown(content: object) -> None:
    for kind in ("plan", EXCHANGE):
        shown(kind, json.dumps(content))


def test_an_error_that_is_no_list_is_shown() -> None:
    assert shown(EXCHANGE, '{"error": 5}') == ("no answer: 5", "")


@pytest.mark.slow
def test_reasons_keep_to_the_limit_and_empty_ones_are_left_out() -> None:
    others = tuple(f"{i}" + "\U000e0001" * 100_000 for i in range(1000))
    shown(REASON, Reason(Cause.YIELD, others).to_note().text)
    shown(REASON, "\U000e0001" * 100_000)
    assert shown(REASON, '{"cause":"yield","distance_m":1' + "0" * 400 + "}")[0].startswith('{"cause"')
    episode: Any = SimpleNamespace(notes=[NoteRecord(1, "0", Note(REASON, " \n"))], restore_names=str)
    assert list_notes(episode) == []
