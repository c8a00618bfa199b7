"""The data folder of a server: private to its user, and served by one process at a time."""

import os
import socket
from collections.abc import Generator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING

from sqlalchemy import make_url
from sqlalchemy.exc import ArgumentError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder, open_appended
from mdrive_sumo.core.posix import import_posix
from server.settings import ServerSettings

if TYPE_CHECKING:
    import fcntl
else:
    fcntl = import_posix("fcntl")

LOCK_FILE = "serve.lock"
FOLDER_MODE = 0o700
"""Archives, results and the database are for the server's user only. Boxes get bind mounts of what they may see."""


@contextmanager
def lock_data_folder(settings: ServerSettings) -> Generator[None]:
    """Create the data folder, make it private, and lock it with its database.

    With SQLite, in the data folder or elsewhere, one process serves the folder and the database. With PostgreSQL one
    process of each machine serves the folder. Raises InputError if another process serves it.
    """
    _make_folder(settings.data)
    with ExitStack() as stack:
        for file, operation in _list_locks(settings):
            stack.enter_context(_lock(file, operation, settings.data))
        yield


def _make_folder(folder: Path) -> None:
    try:
        make_folder(folder, FOLDER_MODE, may_be_link=True)
    except OSError as error:
        raise InputError(f"serve: {folder}: cannot be created: {error.strerror}; choose another --data") from None
    with suppress(PermissionError):  # a folder of another user, who decides
        folder.chmod(FOLDER_MODE)


def _list_locks(settings: ServerSettings) -> list[tuple[Path, int]]:
    own = settings.data / LOCK_FILE
    database = find_database_file(settings)
    if database is None:  # several machines may share the folder, but none with a server that has it for itself
        machine = settings.data / f"serve.{socket.gethostname()[:64]}.lock"
        return [(own, fcntl.LOCK_SH), (machine, fcntl.LOCK_EX)]
    beside = database.with_name(f"{database.name}.{LOCK_FILE}")
    return [(own, fcntl.LOCK_EX), (beside, fcntl.LOCK_EX)]


def find_database_file(settings: ServerSettings) -> Path | None:
    """Return the file of an SQLite database, None for another database."""
    try:
        url = make_url(settings.database_url)
    except ArgumentError:  # `Store` says what is wrong
        return None
    return Path(url.database) if url.get_backend_name() == "sqlite" and url.database else None


@contextmanager
def _lock(path: Path, operation: int, data: Path) -> Generator[None]:
    try:
        file = os.fdopen(open_appended(path), "r+")
    except OSError as error:
        raise InputError(f"serve: {path}: cannot be written: {error.strerror}") from None
    with file:
        try:
            fcntl.flock(file, operation | fcntl.LOCK_NB)
        except OSError:
            file.seek(0)
            pid = file.read().strip() or "?"
            what = data if path.parent == data else path.name.removesuffix(f".{LOCK_FILE}")
            sentence = f"serve: {what} is being served by process {pid}; stop it, or choose another --data"
            raise InputError(sentence) from None
        if operation == fcntl.LOCK_EX:
            file.seek(0)
            file.truncate()
            file.write(f"{os.getpid()}\n")
            file.flush()
        yield
