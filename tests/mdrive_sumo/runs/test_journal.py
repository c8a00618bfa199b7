"""The journal: nothing that was finished is ever lost, and nothing foreign is ever taken over."""

import json
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.journal import FORMAT, JOURNAL_FILE, open_journal

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
    assert lines[0] == {"format": FORMAT, "fingerprint": PRINT}
    assert lines[1] == {"failed": {"scenario": "a", "reason": "killed"}}


def test_fresh_forgets(tmp_path: Path) -> None:
    write(tmp_path, "a")
    with open_journal(tmp_path, {**PRINT, "seed": 1}, fresh=True) as journal:
        assert journal.results == ()
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
    path.write_bytes(path.read_bytes().replace(b'{"result":{"id":"a"}}', b'{"result":{"id":"a'))
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


def test_a_file_that_is_no_journal_is_refused(tmp_path: Path) -> None:
    (tmp_path / JOURNAL_FILE).write_text('{"format": "mdrive-sumo/journal/2"}\n')
    with pytest.raises(InputError, match=r"expected the format mdrive-sumo/journal/1, found 'mdrive-sumo/journal/2'"):
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


def test_a_killed_process_keeps_its_results_and_gives_up_the_lock(tmp_path: Path) -> None:
    ended = subprocess.run([sys.executable, "-c", KILLED.format(print=PRINT), str(tmp_path)])
    assert ended.returncode == -signal.SIGKILL
    assert read(tmp_path) == ["a"]
