"""The journal: nothing that was finished is ever lost, and nothing foreign is ever taken over."""

import json
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from testing.journals import rewrite_journal

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.journal import FORMAT, JOURNAL_FILE, open_journal, read_fingerprint

PRINT = {"agent": "idm", "seed": 0, "suite_checksum": "sha256:" + "a" * 64}


def write(folder: Path, *ids: str) -> None:
    with open_journal(folder, PRINT, fresh=False) as journal:
        for scenario in ids:
            journal.add_result({"id": scenario})


def read(folder: Path) -> list[str]:
    with open_journal(folder, PRINT, fresh=False) as journal:
        return [result["id"] for result in journal.results]


def test_results_come_back_in_order(tmp_path: Path) -> None:
    write(tmp_path, "b", "a")
    write(tmp_path, "c")
    assert read(tmp_path) == ["b", "a", "c"]


def test_failed_tries_are_kept_but_are_no_results(tmp_path: Path) -> None:
    with open_journal(tmp_path, PRINT, fresh=False) as journal:
        journal.add_failure("a", "killed")
        journal.add_result({"id": "a"})
    assert read(tmp_path) == ["a"]
    lines = [json.loads(line) for line in (tmp_path / JOURNAL_FILE).read_text().splitlines()]
    assert all(len(line.pop("checksum")) == 16 for line in lines)
    assert lines[0] == {"format": FORMAT, "fingerprint": PRINT}
    assert lines[1] == {"failed": {"scenario": "a", "reason": "killed"}}


def test_fresh_forgets(tmp_path: Path) -> None:
    write(tmp_path, "a")
    with open_journal(tmp_path, {**PRINT, "seed": 1}, fresh=True) as journal:
        assert journal.results == ()
        journal.add_result({"id": "a"})
    with pytest.raises(InputError, match="seed 1"):
        read(tmp_path)


@given(cut=st.integers(min_value=1, max_value=400))
def test_any_torn_end_loses_at_most_the_lines_that_were_cut(tmp_path_factory: pytest.TempPathFactory, cut: int) -> None:
    folder = tmp_path_factory.mktemp("torn")
    path = folder / JOURNAL_FILE
    write(folder, "a", "b", "c")
    whole = path.read_bytes()
    left = whole[: max(0, len(whole) - cut)]
    path.write_bytes(left)
    with open_journal(folder, PRINT, fresh=False) as journal:
        assert journal.torn == (not left.endswith(b"\n") and left != b"")
        kept = [result["id"] for result in journal.results]
        journal.add_result({"id": "d"})
    assert kept == ["a", "b", "c"][: max(0, left.count(b"\n") - 1)]
    assert read(folder) == [*kept, "d"]


def test_a_last_line_of_zeros_is_dropped(tmp_path: Path) -> None:
    write(tmp_path, "a")
    with (tmp_path / JOURNAL_FILE).open("ab") as file:
        file.write(b"\0" * 100)
    assert read(tmp_path) == ["a"]


def test_a_corrupt_line_in_the_middle_is_refused(tmp_path: Path) -> None:
    write(tmp_path, "a", "b")
    path = tmp_path / JOURNAL_FILE
    path.write_bytes(path.read_bytes().replace(b'{"result":{"id":"a"}', b'{"result":{"id":"a'))
    with pytest.raises(InputError, match=r"line 2: expected a JSON object.*--fresh"):
        read(tmp_path)


def test_a_journal_of_another_command_is_refused_and_left_alone(tmp_path: Path) -> None:
    write(tmp_path, "a")
    before = (tmp_path / JOURNAL_FILE).read_bytes()
    with (
        pytest.raises(InputError, match=r"another agent idm \(now omniscient\);.*--fresh.*--out"),
        open_journal(tmp_path, {**PRINT, "agent": "omniscient"}, fresh=False),
    ):
        pass
    assert (tmp_path / JOURNAL_FILE).read_bytes() == before


@pytest.mark.parametrize(
    ("before", "now", "sentence"),
    [
        (
            {"comm": '{"header_bytes":0,"latency_ticks":0,"preset":"ideal"}'},
            {"comm": '{"header_bytes":0,"latency_ticks":2,"loss":0.1,"preset":"realistic"}'},
            "comm: latency_ticks 0 (now 2), loss none (now 0.1), preset ideal (now realistic);",
        ),
        ({"agent_config": "{}"}, {"agent_config": '{"range":3}'}, "agent_config: range none (now 3);"),
        (
            {"agent_config": json.dumps({str(key): 0 for key in range(6)})},
            {"agent_config": json.dumps({str(key): 1 for key in range(6)})},
            "agent_config: 0 0 (now 1), 1 0 (now 1), 2 0 (now 1), 3 0 (now 1) and 2 more;",
        ),
        ({"scenario": "a" * 50 + "b"}, {"scenario": "a" * 50 + "c"}, "scenario ...aaaab (now ...aaaac);"),
        ({"scenario": "{a,b}"}, {"scenario": "{a,c}"}, "scenario {a,b} (now {a,c});"),
        ({}, {"agent_limits": "tick=30"}, "agent_limits none (now tick=30);"),
    ],
)
def test_another_command_is_told_by_what_differs(
    tmp_path: Path, before: dict[str, str], now: dict[str, str], sentence: str
) -> None:
    with open_journal(tmp_path, before, fresh=False) as journal:
        journal.add_result({"id": "a"})
    with pytest.raises(InputError) as caught, open_journal(tmp_path, now, fresh=False):
        pass
    assert f"found one with another {sentence}" in str(caught.value)


def test_a_journal_in_which_nothing_was_done_gives_way_to_another_command(tmp_path: Path) -> None:
    """Such as that of an agent that was refused when its first episode began."""
    with open_journal(tmp_path, PRINT, fresh=False):
        pass
    with open_journal(tmp_path, {**PRINT, "agent": "omniscient"}, fresh=False):
        pass
    assert read_fingerprint(tmp_path)["agent"] == "omniscient"


def test_a_file_that_is_no_journal_is_refused(tmp_path: Path) -> None:
    (tmp_path / JOURNAL_FILE).write_text('{"format": "mdrive-sumo/journal/9"}\n')
    with pytest.raises(InputError, match=r"line 1: expected a checksum at its end, found none"):
        read(tmp_path)
    (tmp_path / JOURNAL_FILE).unlink()
    write(tmp_path, "a")
    rewrite_journal(tmp_path / JOURNAL_FILE, lambda text: text.replace("journal/2", "journal/9"))
    with pytest.raises(InputError, match=r"expected the format mdrive-sumo/journal/2, found 'mdrive-sumo/journal/9'"):
        read(tmp_path)


@example(place=0.7109375, step=9)  # "ticks":0234 of the last line, which is no JSON
@given(place=st.floats(0, 1, exclude_max=True), step=st.integers(1, 9))
def test_a_changed_digit_is_found_wherever_it_is(
    tmp_path_factory: pytest.TempPathFactory, place: float, step: int
) -> None:
    folder = tmp_path_factory.mktemp("digit")
    path = folder / JOURNAL_FILE
    with open_journal(folder, PRINT, fresh=False) as journal:
        for scenario, ds in (("a", 12.345678), ("b", 99.5), ("c", 0.25)):
            journal.add_result({"id": scenario, "ds": ds, "ticks": 1234}, "sha256:" + "0123456789abcdef" * 4)
    raw = bytearray(path.read_bytes())
    digits = [i for i, byte in enumerate(raw) if chr(byte).isdigit()]
    at = digits[int(place * len(digits))]
    raw[at] = ord(str((int(chr(raw[at])) + step) % 10))
    path.write_bytes(raw)
    number = raw[:at].count(b"\n") + 1
    with pytest.raises(InputError, match=rf"line {number}: expected "):
        read(folder)
    assert path.read_bytes() == raw


@pytest.mark.parametrize(
    ("change", "line"),
    [
        (lambda lines: [lines[0], *lines[2:]], 2),
        (lambda lines: [lines[0], lines[2], lines[1], *lines[3:]], 2),
        (lambda lines: [*lines, lines[1]], 5),
        (lambda lines: [*lines, b'{"result":{"id":"x"}}\n'], 5),
    ],
    ids=["removed", "swapped", "repeated", "without a checksum"],
)
def test_a_line_removed_swapped_or_inserted_is_found(
    tmp_path: Path, change: Callable[[list[bytes]], list[bytes]], line: int
) -> None:
    write(tmp_path, "a", "b", "c")
    path = tmp_path / JOURNAL_FILE
    path.write_bytes(b"".join(change(path.read_bytes().splitlines(keepends=True))))
    with pytest.raises(InputError, match=rf"line {line}: expected (the|a) checksum"):
        read(tmp_path)


@pytest.mark.parametrize("result", ["7", "[]", "null", '{"ds":1}'])
def test_a_line_with_something_else_than_a_result_is_refused(tmp_path: Path, result: str) -> None:
    write(tmp_path, "a")
    rewrite_journal(tmp_path / JOURNAL_FILE, lambda line: line.replace('{"id":"a"}', result))
    with pytest.raises(InputError, match="line 2: expected a result with an id, found none"):
        read(tmp_path)


def test_two_processes_cannot_share_a_run(tmp_path: Path) -> None:
    with (
        open_journal(tmp_path, PRINT, fresh=False),
        pytest.raises(InputError, match="another process at work"),
    ):
        read(tmp_path)
    assert read(tmp_path) == []


def test_a_folder_that_cannot_be_made(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InputError, match=r"file/run: cannot be written: Not a directory"):
        read(tmp_path / "file" / "run")


FULL_DISK = """
import resource, sys
from pathlib import Path
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.journal import open_journal
resource.setrlimit(resource.RLIMIT_FSIZE, (400, 400))
with open_journal(Path(sys.argv[1]), {print!r}, fresh=False) as journal:
    try:
        for number in range(1000):
            journal.add_result({{"id": str(number)}})
    except InputError as error:
        sys.exit(f"{{number}} {{error}}")
"""


@pytest.mark.slow
def test_a_disk_that_fills_up_leaves_a_usable_journal(tmp_path: Path) -> None:
    """The limit on a file's size stands in for the disk: it takes a part of a line, then refuses."""
    ended = subprocess.run(
        [sys.executable, "-c", FULL_DISK.format(print=PRINT), str(tmp_path)], capture_output=True, text=True
    )
    number, sentence = ended.stderr.strip().split(" ", 1)
    assert sentence == f"{tmp_path / JOURNAL_FILE}: cannot be written: File too large"
    assert (tmp_path / JOURNAL_FILE).stat().st_size == 400
    assert read(tmp_path) == [str(i) for i in range(int(number))]


KILLED = """
import os, signal, sys
from pathlib import Path
from mdrive_sumo.runs.journal import open_journal
with open_journal(Path(sys.argv[1]), {print!r}, fresh=False) as journal:
    journal.add_result({{"id": "a"}})
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.slow
def test_a_killed_process_keeps_its_results_and_gives_up_the_lock(tmp_path: Path) -> None:
    ended = subprocess.run([sys.executable, "-c", KILLED.format(print=PRINT), str(tmp_path)])
    assert ended.returncode == -signal.SIGKILL
    assert read(tmp_path) == ["a"]
