"""Backup, restore and what of the files may go; on both databases."""

import os
import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest
from sqlalchemy.orm import Session
from testing import databases
from testing.store_samples import GOOD, LEASE, NOON, PHASE, S, driven, sent, with_teams

from mdrive_sumo.core.errors import InputError
from server.clock import DAY_US
from server.enums import ChallengeTrack, TokenScope
from server.store import (
    Store,
    StoreUnavailable,
    audit,
    jobs,
    phases,
    queries,
    retention,
    submissions,
    teams,
    tokens,
    workers,
)
from server.store.backup import _copy as copied
from server.store.backup import restore_backup, write_backup
from server.store.retention import RetainedFiles, RetentionPolicy
from server.store.tables import TableBase

pytestmark = pytest.mark.slow

WIDE = replace(PHASE, per_day=1000, in_parallel=1000, in_total=1000)


@pytest.fixture(params=databases.BACKENDS)
def backend(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def store(backend: str) -> Store:
    return databases.emptied(backend)


def contents(store: Store) -> dict[str, list[tuple[object, ...]]]:
    with store.read() as session:
        return {
            table.name: sorted((tuple(row) for row in session.execute(table.select())), key=repr)
            for table in TableBase.metadata.sorted_tables
        }


def filled(store: Store) -> None:
    """One done, one half-way, one queued submission."""
    red, blue = with_teams(store, "red", "blüe", phase=WIDE)
    with store.write() as session:
        tokens.issue(session, teams.get(session, "red"), TokenScope.SUBMIT, NOON)
        driven(session, sent(session, red, NOON), NOON)
        sent(session, blue, NOON + 1, idempotency_key="k")
        job = jobs.claim(session, "w", LEASE, NOON)
        assert job is not None
        jobs.finish(session, job.id, "w", 1, GOOD, NOON)
        assert jobs.claim(session, "w", LEASE, NOON) is not None
        sent(session, blue, NOON + 2)


@pytest.mark.parametrize("target", databases.BACKENDS)
def test_a_backup_restores_everything_on_either_database(store: Store, target: str, tmp_path: Path) -> None:
    filled(store)
    head = write_backup(store, tmp_path / "backup.sqlite")
    assert [path.name for path in tmp_path.iterdir()] == ["backup.sqlite"]
    other = Store(databases.url(target, tmp_path))
    assert restore_backup(other, tmp_path / "backup.sqlite") == head
    assert contents(other) == contents(store)
    with other.write() as session:  # and life goes on: ids are counted on, not from 1
        red = teams.get(session, "red").id
        running = sent(session, red, NOON + 5)
        assert audit.verify_chain(session).broken is None
        assert jobs.reclaim_expired(session, NOON + 2 * LEASE) == 1
        assert submissions.get(session, running.id).state == "queued"
    other.close()


@pytest.mark.parametrize("target", databases.BACKENDS)
def test_a_restore_goes_over_what_a_server_writes_at_its_start(store: Store, target: str, tmp_path: Path) -> None:
    """After a disaster: install, serve, and only then restore."""
    filled(store)
    head = write_backup(store, tmp_path / "backup.sqlite")
    started = Store(databases.url(target, tmp_path))
    started.migrate()
    with started.write() as session:
        phases.set_phases(session, [replace(PHASE, title="As at first"), replace(PHASE, id="other")], NOON + 9)
        workers.record_heartbeat(session, "w", "", NOON + 9)
    assert restore_backup(started, tmp_path / "backup.sqlite") == head
    assert contents(started) == contents(store)
    with started.write() as session:
        phases.set_phases(session, [PHASE], NOON + 10)
        assert audit.verify_chain(session).broken is None
    started.close()


@pytest.mark.parametrize(
    ("deed", "found"),
    [
        (lambda session: teams.create(session, "red", NOON), "audit, teams"),
        (lambda session: tokens.issue(session, None, TokenScope.ADMIN, NOON), "audit, tokens"),
        (lambda session: audit.add_entry(session, "admin", "token-issued", {}, NOON), "audit"),
    ],
)
def test_a_restore_undoes_nothing_that_was_done(
    backend: str, tmp_path: Path, deed: Callable[[Session], object], found: str
) -> None:
    file = tmp_path / "backup.sqlite"
    write_backup(databases.emptied(backend), file)
    store = databases.emptied(backend)
    with store.write() as session:
        phases.set_phases(session, [PHASE], NOON)
        deed(session)
    before = contents(store)
    with pytest.raises(InputError, match=f"expected an empty database, found one with {found} in it$"):
        restore_backup(store, file)
    assert contents(store) == before


def test_a_backup_is_of_one_moment_while_others_write(
    store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    filled(store)
    before = contents(store)

    def interrupted(source: Session, target: Session) -> None:
        copied(source, target)
        with store.write() as session:
            teams.create(session, "late", NOON)

    monkeypatch.setattr("server.store.backup._copy", interrupted)
    head = write_backup(store, tmp_path / "backup.sqlite")
    monkeypatch.undo()
    copy = Store(f"sqlite:///{tmp_path / 'backup.sqlite'}")
    assert contents(copy) == before != contents(store)
    with copy.read() as session:
        assert audit.find_head(session) == head
    copy.close()


def test_nothing_is_overwritten(store: Store, tmp_path: Path) -> None:
    filled(store)
    file = tmp_path / "backup.sqlite"
    write_backup(store, file)
    size = file.stat().st_size
    with pytest.raises(InputError, match="expected a new file"):
        write_backup(store, file)
    assert file.stat().st_size == size
    with pytest.raises(InputError, match="expected an empty database"):
        restore_backup(store, file)
    with pytest.raises(InputError, match="expected a folder that exists"):
        write_backup(store, tmp_path / "none" / "backup.sqlite")


def test_a_failed_backup_leaves_no_file(store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise StoreUnavailable("the disk is full")

    monkeypatch.setattr("server.store.backup._copy", full)
    with pytest.raises(StoreUnavailable):
        write_backup(store, tmp_path / "backup.sqlite")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("content", [None, b"", b"no database" * 1000, "empty database"])
def test_what_is_no_backup_is_refused(store: Store, tmp_path: Path, content: bytes | str | None) -> None:
    file = tmp_path / "backup.sqlite"
    if content == "empty database":
        connection = sqlite3.connect(file)
        connection.execute("CREATE TABLE other (id INTEGER)")
        connection.close()
    elif content is not None:
        file.write_bytes(content)
    with pytest.raises(InputError, match="expected a backup"):
        restore_backup(store, file)


def test_a_backup_with_a_changed_audit_log_is_refused(store: Store, tmp_path: Path) -> None:
    filled(store)
    file = tmp_path / "backup.sqlite"
    write_backup(store, file)
    connection = sqlite3.connect(file)
    connection.execute("UPDATE audit SET actor = 'nobody' WHERE id = (SELECT min(id) FROM audit)")
    connection.commit()
    connection.close()
    other = databases.opened("sqlite", tmp_path)
    with pytest.raises(InputError, match="unbroken audit log, found entry"):
        restore_backup(other, file)
    with other.read() as session:
        assert teams.list_teams(session) == []
    other.close()


def test_files_stay_as_long_as_the_policy_says(store: Store) -> None:
    red, blue = with_teams(store, "red", "blue", phase=WIDE)
    policy = RetentionPolicy(archive_days=100, refused_days=10, recording_days=20)
    with store.write() as session:
        best = sent(session, red, NOON)
        driven(session, best, NOON, ds=90)
        worse = sent(session, red, NOON + 1)
        driven(session, worse, NOON, ds=80)
        joint = sent(session, blue, NOON + 2, track=ChallengeTrack.JOINT)
        driven(session, joint, NOON, ds=10)
        refused, waiting = sent(session, red, NOON + 3), sent(session, red, NOON + 4)
        submissions.reject(session, refused.id, "why", NOON + S)

        def at(days: int) -> tuple[set[str], set[str]]:
            found = retention.select_retained(session, policy, NOON + 2 * S + days * DAY_US)
            names = {"best": best, "worse": worse, "joint": joint, "refused": refused, "waiting": waiting}
            return (
                {name for name, submission in names.items() if submission.archive_sha256 in found.archives},
                {name for name, submission in names.items() if submission.id in found.recordings},
            )

        always = {"best", "joint", "waiting"}
        assert at(9) == (always | {"worse", "refused"}, always | {"worse", "refused"})
        assert at(11) == (always | {"worse"}, always | {"worse", "refused"})
        assert at(21) == (always | {"worse"}, always)
        assert at(101) == (always, always)
        submissions.disqualify(session, best.id, "why", NOON + S)
        assert at(101)[0] == {"worse", "joint", "waiting"}  # the second of red stands there now


def test_an_archive_stays_while_any_submission_needs_it(store: Store) -> None:
    red, blue = with_teams(store, "red", "blue", phase=WIDE)
    with store.write() as session:
        submissions.cancel(session, sent(session, red, NOON, archive_sha256="f" * 64).id, NOON)
        sent(session, blue, NOON, archive_sha256="f" * 64)
        assert retention.select_retained(session, RetentionPolicy(), NOON + 10_000 * DAY_US).archives == {"f" * 64}


def test_only_old_files_that_need_not_stay_are_deleted(tmp_path: Path) -> None:
    outside = tmp_path / "outside"
    outside.mkdir()
    (outside / "precious").write_text("x")
    for path in (
        "archives/old.zip",
        "archives/kept.zip",
        "archives/young.zip",
        "recordings/old/a",
        "recordings/kept/a",
    ):
        (tmp_path / path).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / path).write_text("x")
    (tmp_path / "recordings" / "link").symlink_to(outside)
    long_ago_s = (NOON - 2 * DAY_US) // S
    for path in [*tmp_path.rglob("*")]:
        os.utime(path, (long_ago_s, long_ago_s), follow_symlinks=False)
    os.utime(tmp_path / "archives" / "young.zip", (NOON // S, NOON // S))
    deleted = retention.delete_expired(RetainedFiles(frozenset({"kept"}), frozenset({"kept"})), tmp_path, NOON)
    assert {path.name for path in deleted} == {"old.zip", "old", "link"}
    left = {str(path.relative_to(tmp_path)) for path in tmp_path.rglob("*") if not path.is_dir()}
    assert left == {"archives/kept.zip", "archives/young.zip", "recordings/kept/a", "outside/precious"}


def test_nothing_to_delete_where_nothing_is(tmp_path: Path) -> None:
    assert retention.delete_expired(RetainedFiles(frozenset(), frozenset()), tmp_path, NOON) == []


def test_standing_is_by_phase_track_and_team(store: Store) -> None:
    (red,) = with_teams(store, "red", phase=WIDE)
    with store.write() as session:
        wanted = set()
        for number, track in enumerate((ChallengeTrack.SINGLE, ChallengeTrack.SHARING)):
            better = sent(session, red, NOON + 2 * number, track=track)
            driven(session, better, NOON, ds=50)
            worse = sent(session, red, NOON + 2 * number + 1, track=track)
            driven(session, worse, NOON, ds=40)
            wanted.add(better.id)
        assert queries.find_standing_ids(session) == wanted
