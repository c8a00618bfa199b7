"""Transactions, migrations and what happens when the database is not there, on both databases."""

import shutil
import sqlite3
import subprocess
import sys
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext
from sqlalchemy import inspect, text
from sqlalchemy.exc import DBAPIError
from testing import databases
from testing.paths import ROOT

from mdrive_sumo.core.errors import InputError
from server.store import Store, StoreUnavailable, audit, engine, teams
from server.store.tables import TableBase


@pytest.fixture(params=databases.BACKENDS)
def backend(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def store(backend: str) -> Store:
    return databases.emptied(backend)


@pytest.mark.slow
def test_the_migrations_make_the_tables_of_the_models(backend: str, tmp_path: Path) -> None:
    store = databases.opened(backend, tmp_path)
    with store.engine.connect() as connection:
        assert compare_metadata(MigrationContext.configure(connection), TableBase.metadata) == []
        made = {
            table: {index["name"] for index in inspect(connection).get_indexes(table)}
            for table in ("jobs", "submissions")
        }
    assert "jobs_to_claim" in made["jobs"] and "submissions_by_state" in made["submissions"]
    store.close()


@pytest.mark.slow
def test_several_processes_may_migrate_at_once(backend: str, tmp_path: Path) -> None:
    stores = [Store(databases.url(backend, tmp_path))]
    stores += [Store(stores[0].url.render_as_string(hide_password=False)) for _ in range(2)]
    assert stores[0].version() is None
    with ThreadPoolExecutor(3) as pool:
        list(pool.map(Store.migrate, stores))
    assert [store.version() for store in stores] == ["1"] * 3
    for store in stores:
        store.close()


def test_a_database_of_a_newer_version_is_refused(backend: str, tmp_path: Path) -> None:
    store = databases.opened(backend, tmp_path)
    with store.write() as session:
        session.execute(text("UPDATE alembic_version SET version_num = '9999'"))
    with pytest.raises(InputError, match="of this version or older"):
        store.migrate()
    store.close()


def test_a_failed_write_leaves_nothing(store: Store) -> None:
    with pytest.raises(ZeroDivisionError), store.write() as session:
        teams.create(session, "lost", 1)
        raise ZeroDivisionError
    with store.read() as session:
        assert teams.list_teams(session) == []


def test_a_reader_cannot_write_and_sees_one_moment(store: Store) -> None:
    with store.read() as before:
        assert teams.list_teams(before) == []
        with store.write() as session:  # does not wait for the reader
            teams.create(session, "new", 1)
        assert teams.list_teams(before) == []
    with store.read() as after:
        assert len(teams.list_teams(after)) == 1
    with pytest.raises((DBAPIError, StoreUnavailable)), store.read() as session:
        teams.create(session, "written by a reader", 1)
    with store.write() as session:  # and the connection it used can be written with again
        teams.create(session, "other", 1)


@pytest.mark.slow
def test_there_is_one_writer_at_a_time(store: Store) -> None:
    """The second writer waits before it reads: it sees what the first wrote."""
    entered = threading.Event()
    seen: list[int] = []

    def second() -> None:
        entered.wait(10)
        with store.write() as session:
            seen.append(len(teams.list_teams(session)))

    thread = threading.Thread(target=second)
    thread.start()
    with store.write() as session:
        assert teams.list_teams(session) == []
        entered.set()
        time.sleep(0.3)
        assert seen == []
        teams.create(session, "first", 1)
    thread.join(20)
    assert seen == [1]


def test_sqlite_writers_begin_immediately_in_wal_mode_and_wait_30_s(tmp_path: Path) -> None:
    store = databases.opened("sqlite", tmp_path)
    with store.write() as session:
        connection = session.connection()  # nothing was written yet, and others are already kept out
        pragmas = {
            name: connection.exec_driver_sql(f"PRAGMA {name}").scalar() for name in ("journal_mode", "synchronous")
        }
        timeout = connection.exec_driver_sql("PRAGMA busy_timeout").scalar()
        foreign = connection.exec_driver_sql("PRAGMA foreign_keys").scalar()
        other = sqlite3.connect(str(store.url.database), timeout=0, isolation_level=None)
        with pytest.raises(sqlite3.OperationalError, match="locked"):
            other.execute("BEGIN IMMEDIATE")
        other.close()
    assert (pragmas, timeout, foreign) == ({"journal_mode": "wal", "synchronous": 2}, 30_000, 1)
    store.close()


@pytest.mark.slow
def test_a_database_locked_for_too_long_is_unavailable(
    backend: str, store: Store, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("server.store.engine.BUSY_S", 1)
    impatient = Store(store.url.render_as_string(hide_password=False))
    with store.write() as session:
        session.connection()
        with pytest.raises(StoreUnavailable, match="lock"), impatient.write() as other:
            teams.list_teams(other)
    impatient.close()


def test_a_database_that_is_not_there_is_unavailable(tmp_path: Path) -> None:
    store = Store(f"postgresql://postgres@/none?host={tmp_path}")
    with pytest.raises(StoreUnavailable, match="does not answer"), store.read() as session:
        teams.list_teams(session)
    store.close()


def test_a_full_disk_is_unavailable_and_loses_nothing(tmp_path: Path) -> None:
    """SQLite's own page limit stands for the disk: the error is the same."""
    store = databases.opened("sqlite", tmp_path)
    with store.write() as session:
        teams.create(session, "before", 1)
    with pytest.raises(StoreUnavailable, match="full"), store.write() as session:
        pages = session.connection().exec_driver_sql("PRAGMA page_count").scalar()
        session.connection().exec_driver_sql(f"PRAGMA max_page_count={pages}")
        for number in range(2000):
            teams.create(session, f"team {number}", 1)
    with store.read() as session:
        assert [team.name for team in teams.list_teams(session)] == ["before"]
    store.close()


@pytest.mark.parametrize("url", ["", "mysql://host/name", "sqlite://", "sqlite:///:memory:", "no url"])
def test_other_databases_are_refused(url: str) -> None:
    with pytest.raises(InputError, match="database: expected"):
        Store(url)


def test_connections_cut_by_a_restart_are_opened_again() -> None:
    store = databases.emptied("postgresql")
    with store.write() as session:
        teams.create(session, "before", 1)
    with pytest.raises(StoreUnavailable), store.write() as session:
        teams.create(session, "in between", 1)
        _cut_all_connections(store)
        teams.create(session, "never", 1)
    with store.write() as session:
        teams.create(session, "after", 1)
        assert [team.name for team in teams.list_teams(session)] == ["after", "before"]


def _cut_all_connections(store: Store) -> None:
    with store.read() as session:
        cut = "SELECT pg_terminate_backend(pid) FROM pg_stat_activity WHERE datname = current_database()"
        session.execute(text(cut + " AND pid <> pg_backend_pid()"))


_KILLED = """
import sys, time
from server.store import Store, teams
store = Store(sys.argv[1])
with store.write() as session:
    teams.create(session, "half-way", 1)
    print("in", flush=True)
    time.sleep(60)
"""


@pytest.mark.slow
def test_a_writer_killed_half_way_leaves_nothing_and_blocks_no_other(store: Store) -> None:
    url = store.url.render_as_string(hide_password=False)
    writer = subprocess.Popen([sys.executable, "-c", _KILLED, url], stdout=subprocess.PIPE, cwd=ROOT)
    assert writer.stdout is not None and writer.stdout.readline() == b"in\n"
    writer.kill()
    writer.wait(10)
    writer.stdout.close()
    with store.write() as session:
        teams.create(session, "next", 1)
        assert [team.name for team in teams.list_teams(session)] == ["next"]
        assert audit.verify_chain(session).entries == 1


SECOND_MIGRATION = """
import sqlalchemy as sa
from alembic import op

revision = "2"
down_revision = "1"


def upgrade() -> None:
    op.add_column("teams", sa.Column("city", sa.String(40), nullable=False, server_default="unknown"))
"""


def test_a_later_migration_is_applied_to_the_rows_that_there_are(
    backend: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """As the next version of the project will do it: one more file beside the first."""
    store = databases.opened(backend, tmp_path)
    with store.write() as session:
        teams.create(session, "red", 1)
    later = tmp_path / "migrations"
    shutil.copytree(engine._MIGRATIONS, later, ignore=shutil.ignore_patterns("__pycache__"))
    (later / "versions" / "v2_cities.py").write_text(SECOND_MIGRATION)
    monkeypatch.setattr(engine, "_MIGRATIONS", later)
    store.migrate()
    with store.read() as session:
        assert session.execute(text("SELECT name, city FROM teams")).all() == [("red", "unknown")]
        assert [team.name for team in teams.list_teams(session)] == ["red"]
    assert store.version() == "2"
    monkeypatch.undo()
    with pytest.raises(InputError, match="of this version or older"):  # the version before does not know it
        store.migrate()
    store.close()
