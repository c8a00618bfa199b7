"""The one way to write a file: a new one beside its place, renamed into it when it is whole.

What lies at the place is never opened. A link there, such as one that came with a stranger's run folder, is
replaced and not followed, and a reader sees the old file or the new one, never a part.
"""

import errno
import os
import secrets
import shutil
import stat
import tempfile
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from mdrive_sumo.core.posix import find_open_flags

PART_SUFFIX = ".part"
"""Ending of a file that is not whole yet; its name begins with a dot."""
NEW_FILE = find_open_flags("O_WRONLY", "O_CREAT", "O_EXCL", "O_NOFOLLOW", "O_CLOEXEC")
APPENDED_FILE = find_open_flags("O_RDWR", "O_CREAT", "O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC")
FILE_MODE = 0o666
"""Permissions before the umask."""


class NewFile:
    """A file beside `path`, open for writing, that takes its place with `keep` or is removed with `drop`."""

    def __init__(self, path: Path, mode: int = FILE_MODE) -> None:
        """Raises OSError, also if the folder is missing (`make_folder`)."""
        self._path = path
        self._part = path.with_name(f".{secrets.token_hex(8)}{PART_SUFFIX}")
        self.file: BinaryIO = os.fdopen(os.open(self._part, NEW_FILE, mode), "wb")

    def keep(self) -> None:
        """Close the file and rename it into its place. Raises OSError, also if that is a folder."""
        self.file.close()
        self._part.replace(self._path)

    def drop(self) -> None:
        """Close the file, if it is open, and remove it."""
        with suppress(OSError):  # a full disk: what is left in the buffer cannot be written
            self.file.close()
        self._part.unlink(missing_ok=True)


@contextmanager
def new_file(path: Path, mode: int = FILE_MODE) -> Generator[BinaryIO]:
    """Yield a new file that takes the place of `path` when the block succeeds, and is removed otherwise.

    Raises OSError as `NewFile` does.
    """
    new = NewFile(path, mode)
    try:
        yield new.file
        new.keep()
    except BaseException:
        new.drop()
        raise


@contextmanager
def draft_file(path: Path) -> Generator[Path]:
    """Yield the path of a file in a new folder beside `path`, for libraries that open files themselves.

    It takes the place of `path` when the block succeeds. Raises OSError.
    """
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=".", suffix=PART_SUFFIX) as scratch:
        draft = Path(scratch) / path.name
        yield draft
        draft.replace(path)


def create_anew(path: Path) -> BinaryIO:
    """Return a new, empty file for what is written while it is read, such as a log; it replaces one that is there.

    Raises OSError.
    """
    path.unlink(missing_ok=True)
    return os.fdopen(os.open(path, NEW_FILE, FILE_MODE), "wb")


def remove_parts(folder: Path) -> None:
    """Remove what killed processes left half written in a folder that only the caller writes in now."""
    for path in folder.glob(f".*{PART_SUFFIX}"):
        if path.is_dir() and not path.is_symlink():
            shutil.rmtree(path)
        else:
            path.unlink()


def write_bytes(path: Path, data: bytes, mode: int = FILE_MODE) -> None:
    """Write a file; see `new_file`."""
    with new_file(path, mode) as file:
        file.write(data)


def write_text(path: Path, text: str) -> None:
    """Write a text as UTF-8 with the line ends that it has; see `new_file`. What UTF-8 lacks becomes a question mark.

    A lone surrogate, which a name from a damaged file may hold, is all that UTF-8 lacks.
    """
    write_bytes(path, text.encode("utf-8", "replace"))


def make_folder(folder: Path, mode: int = 0o777, *, may_be_link: bool = False) -> Path:
    """Create a folder to write into, and those above it; return it. Raises OSError, also for a link in its place.

    Links above it are followed: they are the user's. Folders inside a stranger's run are checked by
    `input_files.check_tree` before. may_be_link: the folder is the user's or the organiser's as well.
    """
    folder.mkdir(mode=mode, parents=True, exist_ok=True)
    if folder.is_symlink() and not may_be_link:
        raise OSError(errno.ELOOP, "expected a folder to write to, found a link to one", str(folder))
    return folder


def open_appended(path: Path, mode: int = FILE_MODE) -> int:
    """Return the descriptor of a file to read and to write in its place, new or continued.

    Raises OSError for anything but a regular file with one name: what follows a link, or a second name, is not ours.
    """
    descriptor = os.open(path, APPENDED_FILE, mode)
    status = os.fstat(descriptor)
    if not stat.S_ISREG(status.st_mode) or status.st_nlink > 1:
        os.close(descriptor)
        raise OSError(errno.EINVAL, "expected a regular file with one name, found another kind or a hard link")
    return descriptor


def append_text(path: Path, text: str) -> None:
    """Append a text as UTF-8 to a file; see `open_appended`. Raises OSError."""
    with os.fdopen(open_appended(path), "r+b") as file:
        file.seek(0, os.SEEK_END)
        file.write(text.encode("utf-8", "replace"))


def make_parents(path: Path) -> None:
    """Create the folders above a path that the user named; links among them are the user's. Raises OSError."""
    path.parent.mkdir(parents=True, exist_ok=True)


def copy_file(source: Path, target: Path) -> None:
    """Copy the content of a file; see `new_file`. Raises OSError."""
    with source.open("rb") as content, new_file(target) as file:
        shutil.copyfileobj(content, file)
