"""What is read from others are regular files of bounded size: no devices, no pipes, no links inside a run."""

import os
import socket
from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path

import pytest

from mdrive_sumo.core import input_files
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.input_files import check_tree, open_regular, read_bytes, read_text


def make_socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))


KINDS: dict[str, Callable[[Path], object]] = {
    "a device": lambda path: path.symlink_to("/dev/zero"),
    "a pipe": os.mkfifo,
    "a socket": make_socket,
}


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(IsADirectoryError, match="Is a directory"):
        read_bytes(tmp_path)


@pytest.mark.parametrize("kind", KINDS)
def test_only_regular_files_are_read(kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)  # the path of a socket is short
    KINDS[kind](Path("file"))
    for read in (read_bytes, read_text, open_regular):
        with pytest.raises(OSError, match=f"expected a regular file, found {kind}") as caught:
            read(Path("file"))
        assert caught.value.strerror


def test_a_file_that_becomes_a_pipe_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """What was opened is checked, not only what the name stood for before."""
    pipe, plain = tmp_path / "pipe", tmp_path / "plain"
    os.mkfifo(pipe)
    plain.write_text("")
    before = plain.stat()
    monkeypatch.setattr(Path, "stat", lambda *_, **__: before)
    with pytest.raises(OSError, match="found a pipe"):
        open_regular(pipe)


def test_files_have_a_size(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"12345")
    assert read_bytes(path, 5) == b"12345"
    with pytest.raises(OSError, match="expected at most 4 bytes, found 5"):
        read_bytes(path, 4)
    with path.open("wb") as file:
        file.truncate(2**40)  # as large as it says, without a block on the disk
    with pytest.raises(OSError, match="expected at most 268435456 bytes, found 1099511627776"):
        read_bytes(path)


def test_a_file_that_the_user_links_to_is_read(tmp_path: Path) -> None:
    (tmp_path / "real").write_bytes(b"a\r\nb\rc")
    (tmp_path / "file").symlink_to("real")
    assert read_text(tmp_path / "file") == "a\nb\nc"


@pytest.mark.parametrize("place", ["view", "view/deep/index.html", "journal.jsonl"])
@pytest.mark.parametrize("kind", ["link", "pipe"])
def test_a_run_has_nothing_but_files_and_folders(kind: str, place: str, tmp_path: Path) -> None:
    run = tmp_path / "run"
    (run / "view" / "more").mkdir(parents=True)
    (run / "results.json").write_text("{}")
    check_tree(run)
    path = run / (place.replace("view", "view2", 1) if place == "view" else place)
    path.parent.mkdir(parents=True, exist_ok=True)
    if kind == "link":
        path.symlink_to(tmp_path)
    else:
        os.mkfifo(path)
    with pytest.raises(InputError, match=f"expected a run of regular files and folders, found a {kind}; remove it"):
        check_tree(run)


def test_a_run_folder_may_itself_be_a_link(tmp_path: Path) -> None:
    (tmp_path / "disk").mkdir()
    (tmp_path / "run").symlink_to("disk")
    check_tree(tmp_path / "run")


def test_a_run_may_change_while_it_is_looked_at(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that are being written have other names first, and drafts have folders of their own."""
    for name in ("gone", "kept"):
        (tmp_path / f"{name}.part").mkdir()
    (tmp_path / "kept.part" / "file").touch()
    real = os.scandir

    def scan(folder: Path) -> AbstractContextManager[list["os.DirEntry[str]"]]:
        if folder.name == "gone.part":
            folder.rmdir()
        with real(folder) as found:
            entries = list(found)
        if folder.name == "kept.part":
            (folder / "file").unlink()
        return nullcontext(entries)

    with monkeypatch.context() as patch:
        patch.setattr(input_files.os, "scandir", scan)
        check_tree(tmp_path)
    assert [path.name for path in tmp_path.rglob("*")] == ["kept.part"]
    with pytest.raises(InputError, match="cannot be read: No such file or directory"):
        check_tree(tmp_path / "gone.part")


def test_a_run_has_an_end(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for i in range(4):
        (tmp_path / str(i)).mkdir()
    monkeypatch.setattr(input_files, "MAX_ENTRIES", 3)
    with pytest.raises(InputError, match="expected a run of at most 3 files, found more"):
        check_tree(tmp_path)
