"""Check a SQLite file before it is opened as a challenge's database: damaged files get one sentence."""

import sqlite3
from contextlib import closing
from pathlib import Path
from urllib.parse import quote

from mdrive_sumo.core.errors import InputError

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
