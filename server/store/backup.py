"""Backup and restore. A backup is a SQLite file for either database, so it also migrates a challenge to PostgreSQL.

It contains the tables only; archives and recordings are copied as files (docs/server-database.md).
"""

import shutil
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sqlalchemy import ColumnElement, Connection, Table, delete, false, insert, select, text, true
from sqlalchemy.exc import DatabaseError, IntegrityError
from sqlalchemy.orm import Session

from mdrive_sumo.core.errors import InputError
from server.store import audit
from server.store.engine import PRIVATE_MODE, Store, StoreUnavailable, check_sqlite_file
from server.store.row_check import find_row_differences
from server.store.tables import AuditEntryRow, PhaseRow, TableBase, WorkerRow

_CHUNK = 500
"""Rows that are copied at a time: results of scenarios have up to 512 KiB each."""
_STARTUP_ROWS: Mapping[str, ColumnElement[bool]] = {
    PhaseRow.__tablename__: true(),
    WorkerRow.__tablename__: true(),
    AuditEntryRow.__tablename__: AuditEntryRow.action == "phase-set",
}
"""Rows that `serve` writes at its start: a restore may delete them."""


def write_backup(store: Store, file: Path) -> str:
    """Write a consistent copy of all tables to a new file, also while the server runs; return the audit log's head.

    Raises InputError if the file exists, StoreUnavailable if it cannot be written.
    """
    if file.exists():
        raise InputError(f"{file}: expected a new file for the backup, found one that exists")
    with tempfile.TemporaryDirectory(prefix=".backup-", dir=_find_folder(file)) as folder:
        part = Path(folder) / "part.sqlite"
        copy = Store(f"sqlite:///{part}")
        try:
            copy.migrate()
            with store.read() as source, copy.write() as target:
                _copy(source, target)
                head = audit.find_head(source)
            _leave_wal_mode(copy)
        finally:
            copy.close()
        part.chmod(PRIVATE_MODE)
        part.rename(file)
    return head


def restore_backup(store: Store, file: Path) -> str:
    """Fill an empty database from a backup, also of an older version; return the audit log's head.

    Rows that `serve` writes at its start (phases, their audit entries, workers) are replaced. Raises InputError if
    `file` is not a backup, its audit log is broken, a row is not as the log says, or `store` contains anything else.
    """
    if not file.is_file():
        raise InputError(f"{file}: expected a backup, found no file")
    _check_file(file)
    with tempfile.TemporaryDirectory(prefix=".restore-", dir=_find_folder(file)) as folder:
        copy = Store(f"sqlite:///{shutil.copy(file, Path(folder) / 'copy.sqlite')}")
        try:
            _check_backup(copy, file)
            copy.migrate()
            store.migrate()
            with copy.read() as source, store.write() as target:
                return _fill(source, target, file)
        finally:
            copy.close()


def _check_file(file: Path) -> None:
    try:
        check_sqlite_file(file, whole=True)
    except InputError as error:
        raise InputError(
            f"{file}: expected a backup written by `mdrive-sumo admin backup`, found something else ({error})"
        ) from None


def _find_folder(file: Path) -> Path:
    folder = file.absolute().parent
    if not folder.is_dir():
        raise InputError(f"{file}: expected a folder that exists, found none at {folder}")
    return folder


def _check_backup(copy: Store, file: Path) -> None:
    try:
        version = copy.version()
    except (DatabaseError, StoreUnavailable):
        version = None
    if version is None:
        raise InputError(f"{file}: expected a backup written by `mdrive-sumo admin backup`, found something else")


def _fill(source: Session, target: Session, file: Path) -> str:
    chain = audit.verify_chain(source)
    if chain.broken is not None:
        raise InputError(f"{file}: expected an unbroken audit log, found entry {chain.broken} changed")
    if (difference := next(find_row_differences(source), None)) is not None:
        raise InputError(f"{file}: expected rows as its audit log says, found another: {difference}")
    _empty(target)
    _copy(source, target)
    return chain.head


def _empty(target: Session) -> None:
    """Delete the rows of `serve`. Raises InputError if there are others, which a restore would overwrite."""
    filled = [
        table.name
        for table in TableBase.metadata.sorted_tables
        if target.scalar(select(select(table).where(~_STARTUP_ROWS.get(table.name, false())).exists()))
    ]
    if filled:
        raise InputError(f"restore: expected an empty database, found one with {', '.join(sorted(filled))} in it")
    for table in reversed(TableBase.metadata.sorted_tables):
        target.execute(delete(table))


def _copy(source: Session, target: Session) -> None:
    for table in TableBase.metadata.sorted_tables:
        rows = source.execute(select(table).execution_options(yield_per=_CHUNK)).mappings()
        for part in rows.partitions(_CHUNK):
            _insert(target, table, [dict(row) for row in part])
        _set_sequence(target.connection(), table.name, "id" in table.c and table.c["id"].autoincrement is True)


def _insert(target: Session, table: Table, rows: list[dict[str, Any]]) -> None:
    try:
        target.execute(insert(table), rows)
    except IntegrityError as error:  # a damaged file: the rows of a sound one fit together
        raise InputError(f"database: {table.name}: expected rows that fit together, found: {error.orig}") from None


def _set_sequence(target: Connection, table: str, has_sequence: bool) -> None:
    """Continue PostgreSQL's sequence of ids after the copied rows; it would begin at 1."""
    if has_sequence and target.dialect.name == "postgresql":
        sequence = f"pg_get_serial_sequence('{table}', 'id')"
        target.execute(text(f"SELECT setval({sequence}, coalesce(max(id), 1), max(id) IS NOT NULL) FROM {table}"))


def _leave_wal_mode(copy: Store) -> None:
    """Leave WAL mode, so that the backup is one file."""
    copy.engine.dispose()
    raw = copy.engine.raw_connection()
    try:
        raw.cursor().execute("PRAGMA journal_mode=DELETE").close()
    finally:
        raw.close()
