"""Databases for the tests of the store: SQLite files, and a real PostgreSQL started here.

PostgreSQL refuses to run as root: then it runs as the unprivileged user 65534. Its programs are those of the package
`pgserver` or, where that user may not read them, of a system installation. It listens on a socket in its own folder.
"""

import atexit
import contextlib
import importlib.util
import os
import shutil
import signal
import subprocess
import tempfile
import time
from functools import cache
from itertools import count
from pathlib import Path
from typing import Any

import psycopg
import pytest

from server.store import Store
from server.store.tables import TableBase

BACKENDS = ("sqlite", "postgresql")
NOBODY = 65534
_names = count()


@cache
def postgresql() -> str | None:
    """Folder of the socket of a running server; None where no programs are found. It ends with this process."""
    programs = _programs()
    if programs is None:
        return None
    folder = Path(tempfile.mkdtemp(prefix="mdrive-pg-"))
    if os.geteuid() == 0:
        os.chown(folder, NOBODY, NOBODY)
    data = folder / "data"
    quiet: dict[str, Any] = {"cwd": folder, "stdout": subprocess.DEVNULL, "stderr": subprocess.STDOUT, **_user()}
    initdb = [programs / "initdb", "-D", data, "-U", "postgres", "-A", "trust", "-E", "UTF8", "--no-sync"]
    subprocess.run(initdb, check=True, **quiet)
    options = ["-k", folder, "-c", "listen_addresses=", "-c", "fsync=off", "-c", "max_connections=60"]
    server = subprocess.Popen([programs / "postgres", "-D", data, *options], **quiet)
    atexit.register(_stop, server, folder)
    deadline = time.monotonic() + 60
    while True:
        with contextlib.suppress(psycopg.OperationalError), _admin(str(folder)):
            return str(folder)
        assert server.poll() is None and time.monotonic() < deadline, "PostgreSQL does not start"
        time.sleep(0.1)


@cache
def shared(backend: str) -> Store:
    """One migrated database for all tests of this process: making one takes longer than emptying it.

    SQLite's lies in memory: what these tests ask does not depend on the speed of a disk.
    """
    memory = Path("/dev/shm")
    folder = Path(tempfile.mkdtemp(prefix="mdrive-store-", dir=memory if memory.is_dir() else None))
    store = opened(backend, folder)
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    atexit.register(store.close)
    return store


def emptied(backend: str) -> Store:
    """The shared database, as after its first migration."""
    store = shared(backend)
    with store.write() as session:
        for table in reversed(TableBase.metadata.sorted_tables):
            session.execute(table.delete())
    return store


def opened(backend: str, folder: Path) -> Store:
    """A migrated, empty database."""
    store = Store(url(backend, folder))
    store.migrate()
    return store


def url(backend: str, folder: Path) -> str:
    """Of a new database; skips where there is no PostgreSQL."""
    if backend == "sqlite":
        return f"sqlite:///{folder / f'{next(_names)}.sqlite'}"
    socket = postgresql()
    if socket is None:
        pytest.skip("needs PostgreSQL")
    name = f"test_{next(_names)}"
    with _admin(socket) as connection:
        connection.execute(f"CREATE DATABASE {name}")  # pyright: ignore[reportCallIssue]
    return f"postgresql://postgres@/{name}?host={socket}"


def _admin(socket: str) -> psycopg.Connection[Any]:
    return psycopg.connect(host=socket, user="postgres", dbname="postgres", autocommit=True)


def _programs() -> Path | None:
    package = importlib.util.find_spec("pgserver")
    folders = [Path(str(package.origin)).parent / "pginstall" / "bin"] if package else []
    folders += sorted(Path("/usr/lib/postgresql").glob("*/bin"), reverse=True)
    if found := shutil.which("postgres"):
        folders.append(Path(found).parent)
    return next((folder for folder in folders if _runs(folder / "initdb") and _runs(folder / "postgres")), None)


def _runs(program: Path) -> bool:
    try:
        return subprocess.run([program, "--version"], cwd="/", stdout=subprocess.DEVNULL, **_user()).returncode == 0
    except OSError:
        return False


def _user() -> dict[str, Any]:
    return {"user": NOBODY, "group": NOBODY, "extra_groups": []} if os.geteuid() == 0 else {}


def _stop(server: subprocess.Popen[bytes], folder: Path) -> None:
    server.send_signal(signal.SIGINT)  # "fast": open connections are cut
    try:
        server.wait(20)
    except subprocess.TimeoutExpired:
        server.kill()
    shutil.rmtree(folder, ignore_errors=True)
