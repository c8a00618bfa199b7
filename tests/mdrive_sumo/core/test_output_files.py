"""Files are new ones that are renamed into their place: links are not followed, and nothing is half there."""

import os
import stat
from pathlib import Path

import pytest

from mdrive_sumo.core.output_files import (
    NewFile,
    append_text,
    copy_file,
    create_anew,
    draft_file,
    make_folder,
    new_file,
    open_appended,
    remove_parts,
    write_bytes,
    write_text,
)


def list_names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.fixture
def mine(tmp_path: Path) -> Path:
    """A file that a link of a stranger points to."""
    path = tmp_path / "outside"
    path.write_text("mine\n")
    return path


def write_through_draft(path: Path) -> None:
    with draft_file(path) as draft:
        draft.write_text("new")


def write_anew(path: Path) -> None:
    with create_anew(path) as file:
        file.write(b"new")


WRITERS = {
    "text": lambda path: write_text(path, "new"),
    "bytes": lambda path: write_bytes(path, b"new"),
    "draft": write_through_draft,
    "anew": write_anew,
    "copy": lambda path: copy_file(Path(__file__), path),
}


@pytest.mark.parametrize("name", WRITERS)
@pytest.mark.parametrize("target", ["outside", "missing"])
def test_a_link_is_replaced_and_not_followed(name: str, target: str, mine: Path, tmp_path: Path) -> None:
    folder = tmp_path / "run"
    folder.mkdir()
    (folder / "page").symlink_to(tmp_path / target)
    WRITERS[name](folder / "page")
    assert not (folder / "page").is_symlink() and stat.S_ISREG((folder / "page").stat().st_mode)
    assert mine.read_text() == "mine\n" and not (tmp_path / "missing").exists()
    assert list_names(folder) == ["page"]


@pytest.mark.parametrize("name", WRITERS)
def test_a_pipe_is_replaced_and_not_waited_for(name: str, tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "page")
    WRITERS[name](tmp_path / "page")
    assert stat.S_ISREG((tmp_path / "page").stat().st_mode)


def test_a_hard_link_keeps_its_other_name(mine: Path, tmp_path: Path) -> None:
    (tmp_path / "page").hardlink_to(mine)
    write_text(tmp_path / "page", "new")
    assert mine.read_text() == "mine\n"
    (tmp_path / "log").hardlink_to(mine)
    with pytest.raises(OSError, match="one name"):
        append_text(tmp_path / "log", "more")
    assert mine.read_text() == "mine\n"


@pytest.mark.parametrize("kind", ["link", "pipe", "folder", "device"])
def test_nothing_is_appended_to_what_is_no_file(kind: str, mine: Path, tmp_path: Path) -> None:
    path = tmp_path / "journal"
    if kind == "link":
        path.symlink_to(mine)
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    else:
        path = Path("/dev/zero")
    with pytest.raises(OSError, match=r"regular file|symbolic link|directory"):
        os.close(open_appended(path))
    assert mine.read_text() == "mine\n"


def test_a_file_is_whole_or_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "results"
    write_text(path, "old")
    with pytest.raises(RuntimeError), new_file(path) as file:
        file.write(b"half")
        raise RuntimeError
    with pytest.raises(RuntimeError), draft_file(path) as draft:
        draft.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old" and list_names(tmp_path) == ["results"]
    with pytest.raises(IsADirectoryError):
        write_text(tmp_path, "text")


def test_what_a_killed_process_left_is_removed(tmp_path: Path) -> None:
    left = NewFile(tmp_path / "results")
    left.file.write(b"half")
    left.file.close()
    (tmp_path / ".0123abcd.part").mkdir()
    (tmp_path / ".0123abcd.part" / "picture").write_text("half")
    (tmp_path / ".other").write_text("kept")
    assert len(list_names(tmp_path)) == 3
    remove_parts(tmp_path)
    assert list_names(tmp_path) == [".other"]


def test_permissions_are_those_of_any_new_file(tmp_path: Path) -> None:
    write_text(tmp_path / "ours", "text")
    (tmp_path / "plain").write_text("text")
    assert (tmp_path / "ours").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_a_lone_surrogate_is_written_as_a_question_mark(tmp_path: Path) -> None:
    write_text(tmp_path / "page", "a\ud800\r\n")
    assert (tmp_path / "page").read_bytes() == b"a?\r\n"


def test_a_folder_that_is_a_link_is_refused(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "view").symlink_to(tmp_path / "real")
    with pytest.raises(OSError, match="found a link"):
        make_folder(tmp_path / "view")
    assert make_folder(tmp_path / "view", may_be_link=True).is_dir()
    assert make_folder(tmp_path / "a" / "b").is_dir()
