"""Opens the database and its transactions: one writer at a time on SQLite and on PostgreSQL alike.

A challenge writes a few hundred rows a minute, so this costs nothing. In return quotas, the audit chain, the fair order
of claims and the order of events need no locks of their own, and deadlocks are impossible.
"""

import os
import sqlite3
from collections.abc import Generator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any
from urllib.parse import quote

from sqlalchemy import URL, Connection, Engine, create_engine, event, make_url
from sqlalchemy.exc import ArgumentError, DBAPIError, OperationalError
from sqlalchemy.exc import TimeoutError as PoolTimeout
from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder
from server.errors import StoreUnavailable

PRIVATE_MODE = 0o600
"""Mode of databases and backups: they hold hidden results and hashes of tokens."""
BUSY_S = 30
"""Time limit of waiting for another writer [s]. Leases (60 s) must be longer."""
_WRITER_LOCK = 0x6D647269
"""Key of the PostgreSQL advisory lock that every write transaction takes first."""
_MIGRATIONS = Path(__file__).parent / "migrations"


class Store:
    """An open database. `write()` and `read()` open sessions of one transaction each."""

    def __init__(self, url: str) -> None:
        """Open sqlite:///file or postgresql://user@host/name. Raises InputError for other URLs."""
        self.url = _parse_url(url)
        self.engine = _open_sqlite(self.url) if self.is_sqlite else _open_postgresql(self.url)
        self._writer = self.engine.execution_options(writes=True)
        self._reader = self.engine.execution_options(writes=False)

    @property
    def is_sqlite(self) -> bool:
        """Whether the database is a SQLite file."""
        return self.url.get_backend_name() == "sqlite"

    @contextmanager
    def write(self) -> Generator[Session]:
        """Open a write transaction, committed at the end of the block. Raises StoreUnavailable."""
        with _translate_errors(), Session(self._writer, expire_on_commit=False) as session, session.begin():
            yield session

    @contextmanager
    def read(self) -> Generator[Session]:
        """Open a read-only snapshot; it does not wait for writers. Raises StoreUnavailable."""
        with _translate_errors(), Session(self._reader, expire_on_commit=False) as session, session.begin():
            yield session

    def migrate(self) -> None:
        """Migrate the tables to this version of the code; safe to call from several processes at once.

        Raises InputError if a newer version created them, a SQLite file is damaged or its folder cannot be created.
        """
        from alembic import command  # here: workers and their children import the store, and migrate nothing
        from alembic.config import Config
        from alembic.util import CommandError

        if self.is_sqlite:
            _make_folder(Path(str(self.url.database)).parent)
        self.check()
        if self.is_sqlite:
            _make_private(Path(str(self.url.database)))
        with _translate_errors(), self._writer.begin() as connection:
            config = Config()
            config.set_main_option("script_location", str(_MIGRATIONS).replace("%", "%%"))
            config.attributes["connection"] = connection
            try:
                command.upgrade(config, "head")
            except CommandError as error:
                raise InputError(
                    f"database: expected one of this version or older, found one that is neither: {error}"
                ) from None

    def check(self, whole: bool = False) -> None:
        """Raise InputError for a damaged SQLite file; with `whole` every page is read."""
        if self.is_sqlite:
            check_sqlite_file(Path(str(self.url.database)), whole, BUSY_S)

    def version(self) -> str | None:
        """Return the name of the last migration, None for an empty database."""
        from alembic.runtime.migration import MigrationContext

        with _translate_errors(), self._reader.connect() as connection:
            return MigrationContext.configure(connection).get_current_revision()

    def close(self) -> None:
        """Close all connections."""
        self.engine.dispose()


def _parse_url(url: str) -> URL:
    try:
        parsed = make_url(url)
    except ArgumentError:
        parsed = None
    if parsed is None or parsed.get_backend_name() not in ("sqlite", "postgresql"):
        raise InputError(f"database: expected sqlite:///FILE or postgresql://USER@HOST/NAME, found {url!r}")
    if parsed.get_backend_name() == "sqlite" and parsed.database in (None, "", ":memory:"):
        raise InputError(f"database: expected a file after sqlite:///, found {url!r}")
    return parsed.set(drivername={"sqlite": "sqlite", "postgresql": "postgresql+psycopg"}[parsed.get_backend_name()])


def _make_folder(folder: Path) -> None:
    try:
        make_folder(folder, 0o700, may_be_link=True)
    except OSError as error:
        raise InputError(f"database: {folder}: cannot be made: {error.strerror}") from None


def _make_private(file: Path) -> None:
    """Create the database file for its owner only, or make it so; SQLite gives its other files the same mode.

    A file of another user stays as it is. Raises InputError.
    """
    try:
        os.close(os.open(file, os.O_RDWR | os.O_CREAT | os.O_CLOEXEC, PRIVATE_MODE))
        for name in (file.name, f"{file.name}-wal", f"{file.name}-shm"):
            with suppress(FileNotFoundError, PermissionError):
                file.with_name(name).chmod(PRIVATE_MODE)
    except OSError as error:
        raise InputError(f"database: {file}: cannot be opened: {error.strerror}") from None


def _open_sqlite(url: URL) -> Engine:
    engine = create_engine(url, connect_args={"timeout": BUSY_S}, pool_size=10, max_overflow=40)

    @event.listens_for(engine, "connect")
    def prepare(connection: Any, _record: object) -> None:  # pyright: ignore[reportUnusedFunction]
        connection.isolation_level = None  # otherwise the driver begins deferred transactions itself
        for pragma in ("journal_mode=WAL", "synchronous=FULL", "foreign_keys=ON"):
            connection.execute(f"PRAGMA {pragma}").close()

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:  # pyright: ignore[reportUnusedFunction]
        # A deferred transaction that reads and then writes fails at once if another one wrote in between, whatever
        # the busy timeout: write transactions therefore begin immediate.
        writes = connection.get_execution_options().get("writes", False)
        connection.exec_driver_sql(f"PRAGMA query_only={'OFF' if writes else 'ON'}")
        connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")

    return engine


def _open_postgresql(url: URL) -> Engine:
    # The server cuts off a writer that hangs inside a transaction, as if it had died.
    options = f"-c lock_timeout={BUSY_S}s -c idle_in_transaction_session_timeout={BUSY_S}s"
    engine = create_engine(url, connect_args={"options": options}, pool_size=10, max_overflow=40, pool_pre_ping=True)

    @event.listens_for(engine, "begin")
    def begin(connection: Connection) -> None:  # pyright: ignore[reportUnusedFunction]
        if connection.get_execution_options().get("writes", False):
            connection.exec_driver_sql(f"SELECT pg_advisory_xact_lock({_WRITER_LOCK})")
        else:
            connection.exec_driver_sql("SET TRANSACTION ISOLATION LEVEL REPEATABLE READ READ ONLY")

    return engine


@contextmanager
def _translate_errors() -> Generator[None]:
    try:
        yield
    except (OperationalError, PoolTimeout) as error:
        raise StoreUnavailable(f"the database does not answer: {_first_line(error)}") from error
    except DBAPIError as error:
        if type(error.orig) is sqlite3.DatabaseError:  # a malformed file: other errors are subclasses
            raise StoreUnavailable(f"the database is damaged: {_first_line(error)}") from error
        if not error.connection_invalidated:
            raise
        raise StoreUnavailable(f"the database went away: {_first_line(error)}") from error


def _first_line(error: Exception) -> str:
    cause = error.orig if isinstance(error, DBAPIError) and error.orig is not None else error
    return (str(cause).splitlines() or [type(cause).__name__])[0]


VERSION_TABLE = "alembic_version"
_ADVICE = "restore a backup: mdrive-sumo admin restore FILE"


def check_sqlite_file(file: Path, whole: bool, busy_s: float = 30.0) -> None:
    """Raise InputError for a file that is no SQLite database of a challenge; none or an empty one is a new database.

    `whole` reads every page, 1 GB in some seconds; without it the header and the schema only. A locked or unreadable
    file passes: opening it says why.
    """
    if not file.is_file() or not file.stat().st_size:
        return
    try:
        with closing(sqlite3.connect(f"file:{quote(str(file))}?mode=ro", uri=True, timeout=busy_s)) as connection:
            tables = {name for (name,) in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")}
            versions = (
                connection.execute(f"SELECT * FROM {VERSION_TABLE}").fetchall() if VERSION_TABLE in tables else []
            )
            problem = connection.execute("PRAGMA quick_check(1)").fetchone()[0] if whole else "ok"
    except sqlite3.OperationalError:
        return
    except (sqlite3.DatabaseError, UnicodeDecodeError) as error:
        raise InputError(_format_damage(file, str(error))) from None
    if problem != "ok":
        raise InputError(_format_damage(file, str(problem)))
    if not all(isinstance(version, str) for (version, *_) in versions):
        raise InputError(_format_damage(file, f"the version {versions}"))
    if tables and VERSION_TABLE not in tables:
        found = ", ".join(sorted(map(str, tables))[:3])
        raise InputError(f"database: {file}: expected one of a challenge, found another program's with {found!a}")


def _format_damage(file: Path, reason: str) -> str:
    return f"database: {file}: expected a complete SQLite file, found: {' '.join(reason.split())[:200]}; {_ADVICE}"
