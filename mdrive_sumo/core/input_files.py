"""Read files that others may have made: regular files of bounded size only, checked after they are opened.

A device has no end, a pipe waits for a writer, and a file that is larger than memory ends the process. Each raises
OSError with a sentence as its `strerror`, as a missing file does.
"""

import errno
import json
import os
import stat
from collections.abc import Iterator
from contextlib import suppress
from io import BufferedReader
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.posix import find_open_flags

MAX_BYTES = 2**28
"""Bytes of a file that is read as a whole, unless the caller states others. The largest results have 20 MB."""
MAX_ENTRIES = 200_000
"""Files of a folder that a stranger sent. A run of all scenarios with 20 seeds has 20 000."""
OPENED_FILE = find_open_flags("O_RDONLY", "O_NONBLOCK", "O_CLOEXEC")
_KINDS = (
    (stat.S_ISDIR, "a folder"), (stat.S_ISFIFO, "a pipe"), (stat.S_ISCHR, "a device"), (stat.S_ISBLK, "a device"),
    (stat.S_ISSOCK, "a socket"), (stat.S_ISLNK, "a link"),
)  # fmt: skip


def open_regular(path: Path, max_bytes: int = MAX_BYTES) -> BufferedReader:
    """Open a file for reading. Raises OSError for anything but a regular file of at most `max_bytes`."""
    _check(path.stat().st_mode)  # before: opening a device can already do something
    descriptor = os.open(path, OPENED_FILE)
    try:
        status = os.fstat(descriptor)
        _check(status.st_mode)
        if status.st_size > max_bytes:
            raise OSError(errno.EFBIG, f"expected at most {max_bytes} bytes, found {status.st_size}")
        return os.fdopen(descriptor, "rb")
    except BaseException:
        os.close(descriptor)
        raise


def read_bytes(path: Path, max_bytes: int = MAX_BYTES) -> bytes:
    """Return the content of a regular file of at most `max_bytes`. Raises OSError for any other."""
    with open_regular(path, max_bytes) as file:
        data = file.read(max_bytes + 1)
    if len(data) > max_bytes:
        raise OSError(errno.EFBIG, f"expected at most {max_bytes} bytes, found more")
    return data


def read_text(path: Path, max_bytes: int = MAX_BYTES) -> str:
    """Return the text of a regular file; every end of a line is a line feed.

    Raises OSError as `read_bytes`, and UnicodeDecodeError.
    """
    return read_bytes(path, max_bytes).decode("utf-8").replace("\r\n", "\n").replace("\r", "\n")


def read_json_file(path: Path, what: str, format_: str, remedy: str = "") -> dict[str, Any]:
    """Return a JSON object whose key `format` is `format_`.

    what: the file in a sentence, such as "the index of dialogues"; remedy: what makes a missing one. Raises InputError.
    """
    try:
        content: Any = json.loads(read_bytes(path))
    except OSError as error:
        raise InputError(f"{path}: expected {what}, found {error.strerror}{remedy}") from None
    except (ValueError, RecursionError) as error:  # recursion: brackets nested a thousand times
        raise InputError(f"{path}: expected JSON, found an error: {error}") from None
    if not isinstance(content, dict) or content.get("format") != format_:
        found = content.get("format") if isinstance(content, dict) else type(content).__name__
        raise InputError(f"{path}: expected the format {format_!r}, found {found!r:.60}")
    return content


def check_tree(root: Path, what: str = "a run") -> None:
    """Raise InputError unless a folder holds nothing but regular files and folders, and not too many.

    A run has no links: what one points to is not part of it, and what is written into it would go there. The folder
    itself may be a link, since the user named it.
    """
    left, count = [root], 0
    while left:
        folder = left.pop()
        try:
            for path, mode in _list_entries(folder):
                count += 1
                if stat.S_ISDIR(mode):
                    left.append(path)
                elif not stat.S_ISREG(mode):
                    raise InputError(
                        f"{path}: expected {what} of regular files and folders, found {name_kind(mode)}; remove it"
                    )
        except OSError as error:
            if folder != root and isinstance(error, FileNotFoundError):
                continue  # removed meanwhile by a run that goes on
            raise InputError(f"{root}: cannot be read: {error.strerror}") from None
        if count > MAX_ENTRIES:
            raise InputError(f"{root}: expected {what} of at most {MAX_ENTRIES} files, found more")


def _list_entries(folder: Path) -> Iterator[tuple[Path, int]]:
    """Yield path and mode of what is in a folder, without what is removed meanwhile: files that a run renames."""
    with os.scandir(folder) as entries:
        for entry in entries:
            with suppress(FileNotFoundError):
                yield Path(entry.path), entry.stat(follow_symlinks=False).st_mode


def name_kind(mode: int) -> str:
    """Return which kind of file a mode (`st_mode`) is of, e.g. "a pipe"."""
    return next((name for is_kind, name in _KINDS if is_kind(mode)), "another kind of file")


def _check(mode: int) -> None:
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
    if not stat.S_ISREG(mode):
        raise OSError(errno.EINVAL, f"expected a regular file, found {name_kind(mode)}")
