"""Rows changed behind the server's back are found: `admin audit` and `restore` compare them with the audit log."""

import json
import shutil
import sqlite3
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest
import sqlalchemy
from click.testing import CliRunner
from testing import databases
from testing.paths import ROOT
from testing.store_samples import GOOD, LEASE, NOON, PHASE, S, sent, summary, with_teams

from mdrive_sumo.core.errors import InputError
from server.cli import admin
from server.enums import JobKind, JobState, TokenScope
from server.store import Store, audit, cross_play, jobs, phases, submissions, teams, tokens, webhooks
from server.store.backup import restore_backup, write_backup
from server.store.cross_play import CrossPlayScore
from server.store.row_check import find_row_differences
from server.store.tables import JobRow, SubmissionRow, TableBase

pytestmark = pytest.mark.slow


def drive(session: Any, submission: SubmissionRow, ds: float) -> None:
    while (job := jobs.claim(session, "worker", LEASE, NOON)) is not None:
        assert jobs.finish(session, job.id, "worker", job.attempt, GOOD, NOON + S)
    results = summary(ds, submissions.list_finished_jobs(session, submission.id))
    assert submissions.finish_if_complete(session, submission.id, results, NOON + S)


def drive_pair(session: Any, tested: str, others: str) -> None:
    """One scenario under two evaluators, as after an update of the benchmark."""
    for evaluator, ds in (("a", 40.0), ("b", 50.0)):
        pair = {"submission": tested, "others": others, "scenario": "i01", "seed": cross_play.SEED}
        claimed = {"kind": JobKind.CROSS_PLAY.value, "state": JobState.RUNNING.value, "owner": "worker"}
        job = JobRow(**pair, **claimed, evaluator=evaluator)
        session.add(job)
        session.flush()
        assert cross_play.finish(session, job.id, "worker", job.attempt, CrossPlayScore(ds, 0.0, "", ""), NOON + S)


@pytest.fixture(scope="module")
def backup(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A challenge in which everything has happened once; its scores are 80 and 70."""
    folder = tmp_path_factory.mktemp("backup")
    store = databases.emptied("sqlite")
    red, blue = with_teams(store, "red", "blue")
    with store.write() as session:
        phases.set_phases(session, [phases.NewPhase(**{**vars_of(PHASE), "id": "hidden", "public": False})], NOON)
        tokens.issue(session, teams.get(session, "red"), TokenScope.SUBMIT, NOON)
        tokens.issue(session, None, TokenScope.ADMIN, NOON)
        tokens.revoke(session, tokens.list_tokens(session, None)[0].id, NOON)
        shown = sent(session, red, NOON), sent(session, blue, NOON + 1)
        drive(session, shown[0], 80.0)
        drive(session, shown[1], 70.0)
        drive(session, sent(session, blue, NOON + 2, phase="hidden"), 70.0456)
        submissions.cancel(session, sent(session, blue, NOON + 3).id, NOON + 4)
        disqualified = sent(session, red, NOON + 5)
        drive(session, disqualified, 99.0)
        submissions.disqualify(session, disqualified.id, "cheats", NOON + 6)
        hidden = sent(session, red, NOON + 7)
        drive(session, hidden, 60.0)
        submissions.set_shown(session, hidden.id, False, NOON + 8)
        teams.set_hidden(session, blue, True, NOON + 9)
        teams.set_hidden(session, blue, False, NOON + 10)
        drive_pair(session, shown[0].id, shown[1].id)
        webhooks.set_webhook(session, red, "https://ci.example/old", NOON + 11, "submit:red")
        webhooks.set_webhook(session, red, "https://ci.example/hook", NOON + 12, "submit:red")
        webhooks.set_webhook(session, blue, "https://ci.example/blue", NOON + 13, "submit:blue")
        webhooks.remove_webhook(session, blue, NOON + 14, "submit:blue")
        assert not list(find_row_differences(session))
    write_backup(store, folder / "b.sqlite")
    store.close()
    return folder / "b.sqlite"


def vars_of(phase: phases.NewPhase) -> dict[str, Any]:
    return {name: getattr(phase, name) for name in phase.__slots__}


@pytest.fixture
def changed(backup: Path, tmp_path: Path) -> Iterator[tuple[Path, sqlite3.Connection]]:
    file = Path(shutil.copy(backup, tmp_path / "changed.sqlite"))
    connection = sqlite3.connect(file)
    yield file, connection
    connection.close()


def find(file: Path) -> list[str]:
    store = Store(f"sqlite:///{file}")
    try:
        with store.read() as session:
            assert audit.verify_chain(session).broken is None
            return [str(found) for found in find_row_differences(session)]
    finally:
        store.close()


def test_an_honest_backup_has_no_difference(backup: Path, tmp_path: Path) -> None:
    assert find(Path(shutil.copy(backup, tmp_path / "b.sqlite"))) == []


PERFECT = json.dumps(summary(99.5))
ATTACKS = {
    "score": ("UPDATE submissions SET ds = 99.5 WHERE ds = 80", "ds: expected 80.0, found 99.5"),
    "summary": (f"UPDATE submissions SET summary = '{PERFECT}' WHERE ds = 80", "summary: expected the checksum"),
    "all scores": (
        "UPDATE submissions SET ds = 99.5, summary = replace(summary, '80.0', '99.5') WHERE ds = 80",
        "ds: expected 80.0, found 99.5",
    ),
    "standing": ("UPDATE standings SET ds = 99.5 WHERE ds = 80", "ds: expected 80.0, found 99.5"),
    "figures": ("UPDATE standings SET figures = replace(figures, '80.0', '99.5')", "figures: expected {'ds': 80.0"),
    "standing of another": (
        "UPDATE standings SET submission = (SELECT id FROM submissions WHERE state = 'disqualified') WHERE ds = 80",
        "submission: expected ",
    ),
    "no standing": ("DELETE FROM standings WHERE ds = 70", "found no row"),
    "result": ("UPDATE jobs SET result = replace(result, '80.0', '99.5')", "results of its scenarios: expected"),
    "verdict": ("UPDATE jobs SET verdict = 'agent-failed'", "results of its scenarios: expected the checksum"),
    "state": ("UPDATE submissions SET state = 'done' WHERE state = 'disqualified'", "state: expected disqualified"),
    "reason": ("UPDATE submissions SET why = 'late' WHERE state = 'disqualified'", "why: expected 'cheats'"),
    "shown": ("UPDATE submissions SET shown = 1", "shown: expected False, found True"),
    "team": ("UPDATE submissions SET team = (SELECT id FROM teams WHERE name = 'blue')", "team: expected "),
    "track": ("UPDATE submissions SET track = 'joint' WHERE ds = 80", "track: expected 'single-agent'"),
    "age": ("UPDATE submissions SET created_us = 1 WHERE ds = 70", f"created_us: expected {NOON + 1}, found 1"),
    "evaluator": ("UPDATE submissions SET evaluator = '{}'", "evaluator: expected {'version': '1'}, found {}"),
    "archive": ("UPDATE submissions SET archive_sha256 = 'f'", "archive_sha256: expected "),
    "no submission": ("DELETE FROM submissions WHERE ds = 80", "expected a row, as the audit log names it, found none"),
    "hidden team": ("UPDATE teams SET hidden = 1", "hidden: expected False, found True"),
    "name": ("UPDATE teams SET name = 'green' WHERE name = 'blue'", "name: expected 'blue', found 'green'"),
    "scope": ("UPDATE tokens SET scope = 'admin', team = NULL", "scope: expected 'submit', found 'admin'"),
    "revived token": ("UPDATE tokens SET revoked_us = NULL", f"revoked_us: expected {NOON}, found None"),
    "new token": (
        "INSERT INTO tokens (id, hash, scope, created_us) VALUES ('x', 'y', 'admin', 1)",
        "tokens x: expected an entry of the audit log, found none",
    ),
    "public phase": ("UPDATE phases SET public = 1", "phases hidden: public: expected False, found True"),
    "cross-play": (
        "UPDATE jobs SET result = replace(result, '50.0', '99.5')",
        "result: expected [{'ds': 40.0",
    ),
    "no cross-play": (
        "DELETE FROM jobs WHERE kind = 'cross-play'",
        "expected a row, as the audit log names it, found none",
    ),
    "webhook": ("UPDATE webhooks SET url = 'https://evil.example/'", "url_sha256: expected "),
    "secret of a webhook": ("UPDATE webhooks SET secret = 'whsec_AAAA'", "secret_sha256: expected "),
    "no webhook": ("DELETE FROM webhooks", "expected a row, as the audit log names it, found none"),
    "new webhook": (
        "INSERT INTO webhooks SELECT id, 'https://evil.example/', 'whsec_AAAA', 1 FROM teams WHERE name = 'blue'",
        "expected an entry of the audit log, found none",
    ),
    "token of another": ("UPDATE tokens SET hash = 'known' WHERE scope = 'submit'", "hash: expected "),
    "environment": ("UPDATE submissions SET environment = 'mine'", "environment: expected 'python3.11-numpy'"),
    "quota of a team": ("UPDATE submissions SET counts = 0 WHERE ds = 80", "counts: expected True, found False"),
    "no worst scenario": ("DELETE FROM jobs WHERE scenario = 'merge'", "scenarios and seeds: expected the checksum"),
    "overview": (
        "UPDATE job_overviews SET data = replace(data, '80.0', '99.5')",
        "expected the overview of its result, found another or none",
    ),
    "no overview": ("DELETE FROM job_overviews", "expected the overview of its result, found another or none"),
    "quota": ("UPDATE phases SET per_day = 99", "phases dev: per_day: expected 3, found 99"),
}


@pytest.mark.parametrize("name", ATTACKS)
def test_a_row_changed_in_the_database_is_named(changed: tuple[Path, sqlite3.Connection], name: str) -> None:
    file, connection = changed
    sql, says = ATTACKS[name]
    assert connection.execute(sql).rowcount > 0
    connection.commit()
    found = find(file)
    assert any(says in difference for difference in found), found


def test_audit_and_restore_refuse_changed_scores(
    changed: tuple[Path, sqlite3.Connection], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both took the rows' word for it, although the hash chain holds the true score."""
    file, connection = changed
    connection.execute("UPDATE submissions SET ds = 99.5 WHERE ds = 80")
    connection.commit()
    other = databases.opened("sqlite", tmp_path)
    with pytest.raises(InputError, match=r"rows as its audit log says.*submissions \w+: ds: expected 80.0, found 99.5"):
        restore_backup(other, file)
    with other.read() as session:
        assert teams.list_teams(session) == []
    other.close()
    monkeypatch.setenv("MDRIVE_DATA", str(tmp_path / "data"))
    (tmp_path / "data").mkdir()
    shutil.copy(file, tmp_path / "data" / "challenge.sqlite")
    ended = CliRunner().invoke(admin, ["audit"])
    assert ended.exit_code == 1
    assert "ds: expected 80.0, found 99.5" in ended.stderr


COVERED = {
    "teams": "id name created_us hidden",
    "tokens": "id team hash scope created_us revoked_us",
    "phases": "id title suite public opens_us closes_us per_day in_parallel in_total seeds sensor_track_only "
    "cross_play_scenarios",
    "submissions": "id team phase track name archive_sha256 environment state why created_us finished_us counts shown "
    "evaluator summary ds",
    "jobs": "kind submission others scenario seed verdict reason result",
    "job_overviews": "job submission data",
    "standings": "phase slice track sensing_track team evaluator submission method created_us ds figures",
    "webhooks": "team url secret created_us",
    "audit": "at_us actor action data hash",
}
NOT_COVERED = {
    "submissions": "archive_bytes idempotency_key spent_us",
    "jobs": "id evaluator state attempt failures owner lease_us started_us finished_us usage failure",
    "worker_time": "team phase used_us at_us",
    "refused_uploads": "id team at_us",
    "workers": "owner host version scheduler started_us seen_us",
    "webhook_deliveries": "id submission team state attempts next_us created_us problem",
    "events": "id submission at_us kind data",
    "audit": "id",
}
"""docs/server-database.md, "Audit log", says why of each table."""


def test_every_column_is_compared_or_named_in_the_docs() -> None:
    """A new column needs a decision."""
    tables = TableBase.metadata.tables
    told = {
        name: sorted((COVERED.get(name, "") + " " + NOT_COVERED.get(name, "")).split())
        for name in COVERED | NOT_COVERED
    }
    assert told == {name: sorted(column.name for column in table.columns) for name, table in tables.items()}
    page = (ROOT / "docs" / "server-database.md").read_text().partition("## Audit log")[2]
    for table, names in NOT_COVERED.items():
        assert f"`{table}`" in page or table == "audit"
        assert (
            table not in COVERED or [name for name in names.split() if f"`{name}`" not in page and name != "id"] == []
        )


KEYS = {"teams id", "phases id", "submissions id", "tokens id", "job_overviews job", "jobs reason"}
"""References to keys break first; no job of this challenge has a reason. ATTACKS delete rows."""
JSON_COLUMNS = ("data", "result", "summary", "figures", "evaluator")


def alter(column: str, value: Any) -> Any:
    """Another value of the same kind."""
    if column in JSON_COLUMNS and not (column == "evaluator" and not value.startswith("{")):
        return '{"bucket": "other"}'
    if isinstance(value, str):
        return "hidden" if value == PHASE.id else f"{value[:-1]}{'0' if value[-1:] != '0' else '1'}"
    return 1 - value if value in (0, 1) else value + 1


def test_a_change_of_any_compared_column_is_found(changed: tuple[Path, sqlite3.Connection]) -> None:
    store = Store(f"sqlite:///{changed[0]}")
    names = [f"{table} {column}" for table, columns in COVERED.items() for column in columns.split()]
    for name in (name for name in names if name not in KEYS and not name.startswith("audit")):
        table, column = name.split()
        with suppress(InterruptedError), store.write() as session:
            first = (
                session.execute(sqlalchemy.text(f"SELECT {column} FROM {table} WHERE {column} IS NOT NULL"))
                .scalars()
                .first()
            )
            assert first is not None, name
            session.execute(sqlalchemy.text("PRAGMA defer_foreign_keys = ON"))
            change = sqlalchemy.text(f"UPDATE OR IGNORE {table} SET {column} = :new WHERE {column} = :old")
            session.execute(change, {"new": alter(column, first), "old": first})
            assert next(find_row_differences(session), None) is not None, (name, first, alter(column, first))
            raise InterruptedError
    store.close()
