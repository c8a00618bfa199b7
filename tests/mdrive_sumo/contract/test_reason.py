"""Reasons as notes: they come back as they were, notes of any content are read, and only changes are noted."""

import json

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import MAX_OTHER_NAME, MAX_OTHERS, REASON, Cause, Note, Reason, ReasonLog, check_reply
from mdrive_sumo.contract.exchange import STANDSTILL, Reply

tenths = st.integers(-10_000, 10_000).map(lambda number: number / 10)
reasons = st.builds(
    Reason,
    st.sampled_from(Cause),
    st.lists(st.text(max_size=9), max_size=MAX_OTHERS).map(tuple),
    st.none() | st.tuples(tenths, tenths),
    st.none() | tenths,
    st.none() | tenths.map(abs),
    st.none() | tenths,
)


@given(reasons)
def test_a_reason_survives_its_note(reason: Reason) -> None:
    note = reason.to_note()
    assert Reason.from_note(note) == reason
    assert check_reply(Reply(STANDSTILL, notes=(note,)), frozenset()).notes == (note,)


@given(reasons)
def test_only_another_cause_or_road_user_is_noted(reason: Reason) -> None:
    log = ReasonLog()
    assert log.record(reason) == (reason.to_note(),)
    later = Reason(reason.cause, reason.others, (1.0, 2.0), 3.0, 4.0, 5.0)
    assert log.record(later) == ()
    other = Reason(reason.cause, (*reason.others, "x"))
    assert len(log.record(other)) == 1
    assert log.record(reason) == (reason.to_note(),)


@pytest.mark.parametrize(
    "text",
    [
        "yields to the van", "", "[]", "5", "{}", '{"cause": "boredom"}', '{"cause": 5}', '{"cause": ["free"]}',
        '{"cause": "free", "speed": "fast"}', '{"cause": "free", "speed": NaN}', '{"cause": "free", "seconds": true}',
        '{"cause": "free", "position": [1]}', '{"cause": "free", "position": [1, null]}',
        '{"cause": "free", "position": 3}', '{"cause": "free", "others": 3}', "[" * 100_000, "9" * 10_000,
        '{"cause": "free", "speed": 1' + "0" * 400 + "}", '{"cause": "free", "speed": -1' + "0" * 400 + "}",
        '{"cause": "free", "distance_m": 1e308}', '{"cause": "free", "seconds": 1e999}',
        '{"cause": "free", "seconds": -2}', '{"cause": "free", "position": [1, 1' + "0" * 400 + "]}",
        '{"cause": "free", "position": [1e308, 0]}', '{"cause": "free", "position": "12"}',
        '{"cause": "free", "position": {"1": 2, "3": 4}}', '{"cause": "free", "others": "van"}',
        '{"cause": "free", "others": {"van": 1}}', '{"cause": "free", "others": ["van", 3]}',
        '{"cause": "free", "others": null}',
    ],
)  # fmt: skip
def test_a_note_that_holds_no_reason_is_none(text: str) -> None:
    assert Reason.from_note(Note(REASON, text)) is None


def test_a_reason_that_is_read_is_small() -> None:
    others = ["x" * 100_000, *map(str, range(100_000))]
    reason = Reason.from_note(Note(REASON, json.dumps({"cause": "yield", "others": others})))
    assert reason is not None and reason.others == ("x" * MAX_OTHER_NAME, *map(str, range(MAX_OTHERS - 1)))


def test_a_note_of_another_kind_is_no_reason() -> None:
    assert Reason.from_note(Note("plan", Reason(Cause.FREE).to_note().text)) is None


def test_numbers_without_end_and_many_names_are_left_out() -> None:
    note = Reason(Cause.YIELD, tuple("abcdefghijk"), distance_m=float("inf"), seconds=0.04).to_note()
    assert json.loads(note.text) == {"cause": "yield", "others": list("abcdefgh"), "seconds": 0.0}
