"""The journal of a take: what was appended is read back, whatever happens to its end, and damage costs one sentence."""

import errno
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.contract import Control
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.takes import Action, DriverChoice
from server.drive.worker.take_journal import (
    CavAction,
    JournalHeader,
    TakeJournal,
    TickActions,
    read_journal,
    summarize_journal,
)

HEADER = JournalHeader(2, 1, 1, 0)
FIRST = TickActions({"a": CavAction(Action(DriverChoice("human", {"device": "wheel"}), Control(0.5, 0.0, -0.25)), 7)})
SECOND = TickActions({"b": CavAction(Action(None, None, ("go on", "ü")))}, ("a",), "00112233445566ff")


def write(path: Path, *ticks: TickActions) -> TakeJournal:
    journal = TakeJournal.create(path, HEADER, ticks[:1])
    for tick, actions in enumerate(ticks[1:], 1):
        journal.append(tick, actions)
    return journal


def test_actions_are_read_back(tmp_path: Path) -> None:
    path = tmp_path / "2.actions.jsonl"
    write(path, FIRST, SECOND, TickActions(digest="a" * 16)).close()
    assert read_journal(path) == (HEADER, [FIRST, SECOND, TickActions(digest="a" * 16)])
    assert summarize_journal(path) == (HEADER, 3)


@pytest.mark.parametrize("torn", [1, 5, 40])
def test_a_torn_line_is_left_out_and_written_over(tmp_path: Path, torn: int) -> None:
    path = tmp_path / "2.actions.jsonl"
    write(path, FIRST, SECOND).close()
    path.write_bytes(path.read_bytes()[:-torn])
    assert read_journal(path) == (HEADER, [FIRST])
    journal = TakeJournal(path)
    journal.append(1, SECOND)
    journal.close()
    assert read_journal(path) == (HEADER, [FIRST, SECOND])


def test_a_full_disk_leaves_nothing_of_the_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "2.actions.jsonl"
    journal, pwrite = write(path, FIRST), os.pwrite

    def write_a_part(descriptor: int, data: bytes, offset: int) -> int:
        if len(data) <= 10:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return pwrite(descriptor, data[:-10], offset)

    with monkeypatch.context() as patch:
        patch.setattr(os, "pwrite", write_a_part)
        with pytest.raises(OSError, match="No space left"):
            journal.append(1, SECOND)
    assert path.read_bytes().endswith(b"}\n")
    journal.append(1, SECOND)
    assert read_journal(path)[1] == [FIRST, SECOND]
    journal.close()


@given(
    st.lists(
        st.builds(
            TickActions,
            st.dictionaries(
                st.text("abc_0", min_size=1, max_size=4),
                st.builds(
                    CavAction,
                    st.builds(
                        Action,
                        st.sampled_from([None, DriverChoice("sharing"), DriverChoice("human", {"device": "script"})]),
                        st.none() | st.builds(Control, st.floats(0, 1), st.floats(0, 1), st.floats(-1, 1)),
                        st.lists(st.text(max_size=5).filter(lambda text: text.isprintable()), max_size=2).map(tuple),
                    ),
                    st.integers(0, 2**32 - 1),
                ),
                max_size=3,
            ),
            st.lists(st.text("ab", max_size=3), max_size=2).map(tuple),
            st.sampled_from(["", "0" * 16]),
        ),
        max_size=5,
    )
)
def test_every_action_is_read_back_exactly(tmp_path_factory: pytest.TempPathFactory, ticks: list[TickActions]) -> None:
    path = tmp_path_factory.mktemp("journal") / "1.actions.jsonl"
    TakeJournal.create(path, HEADER, ticks).close()
    assert read_journal(path)[1] == ticks


GOOD = b'{"format":"mdrive-sumo/drive-actions/1","take":2,"parent":1,"tick":1,"entered_tick":0}\n'


@pytest.mark.parametrize(
    ("content", "sentence"),
    [
        (b"", "empty file"),
        (b"no newline", "empty file"),
        (b"[1]\n", "line 1: expected a JSON object, found a list"),
        (b"{}\n", "expected mdrive-sumo/drive-actions/1, found None"),
        (GOOD.replace(b'"take":2', b'"take":-2'), "line 1: expected whole numbers"),
        (GOOD.replace(b'"tick":1', b'"tick":1.5'), "line 1: expected whole numbers"),
        (GOOD + b'{"t":1}\n', "line 2: expected tick 0, found 1"),
        (GOOD + b'{"t":0}\nxxx\n{"t":2}\n', "line 3: expected a JSON object"),
        (GOOD + b'{"t":0,"h":"12"}\n', "line 2: h: expected 16 hexadecimal digits"),
        (GOOD + b'{"t":0,"c":[]}\n', "line 2: expected actions by CAV"),
        (GOOD + b'{"t":0,"left":[1]}\n', "line 2: expected actions by CAV"),
        (GOOD + b'{"t":0,"c":{"a":3}}\n', "line 2: a: expected an object"),
        (GOOD + b'{"t":0,"c":{"a":{"u":[1,2]}}}\n', "line 2: a: u: expected throttle, brake and steer"),
        (GOOD + b'{"t":0,"c":{"a":{"u":[NaN,0,0]}}}\n', "line 2: a: throttle: expected a number"),
        (GOOD + b'{"t":0,"c":{"a":{"u":[2,0,0]}}}\n', "line 2: a: throttle: expected a number"),
        (GOOD + b'{"t":0,"c":{"a":{"n":"1"}}}\n', "line 2: a: expected a number of an input"),
        (GOOD + b'{"t":0,"c":{"a":{"d":{"driver":7}}}}\n', "line 2: a: expected a driver"),
        (GOOD + b"[" * 100_000 + b"\n", "line 2: expected a JSON object"),
    ],
)
def test_a_damaged_journal_costs_one_sentence(tmp_path: Path, content: bytes, sentence: str) -> None:
    path = tmp_path / "2.actions.jsonl"
    path.write_bytes(content)
    with pytest.raises(InputError) as caught:
        read_journal(path)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_missing_journal_costs_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"9\.actions\.jsonl: cannot be read: No such file"):
        read_journal(tmp_path / "9.actions.jsonl")
