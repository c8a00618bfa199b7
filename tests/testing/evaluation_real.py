"""Real workers of a challenge without a simulation: what tests do to them, and what they look at. No tests in here."""

import os
import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Generator
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from unittest.mock import patch

from server.enums import JobState, SubmissionState
from server.evaluation import supervisor
from server.evaluation.summary import summarise
from server.evaluation.supervisor import Supervisor
from server.settings import ServerSettings
from server.store import Store, StoreUnavailable, audit
from server.store.tables import AuditEntryRow, EventRow, JobRow
from testing import processes
from testing.evaluation_fakes import fast_clock, read, scored
from testing.paths import TESTS

wait_for = partial(processes.wait_for, limit_s=120.0)
COMMAND = (sys.executable, "-m", "testing.evaluation_fakes")


@contextmanager
def supervised(store: Store, settings: ServerSettings) -> Generator[Supervisor]:
    found = Supervisor(store, settings, COMMAND, fast_clock)
    found.start()
    try:
        with patch.object(supervisor, "MAX_PAUSE_S", 0.5):
            yield found
    finally:
        found.stop()


def rows(store: Store, submission: str) -> list[JobRow]:
    with store.read() as session:
        return list(session.query(JobRow).filter(JobRow.is_of(submission)).order_by(JobRow.scenario))


def count_spot_checks(store: Store) -> int:
    """How many the audit log tells of."""
    with store.read() as session:
        return session.query(AuditEntryRow).filter_by(action="spot-check").count()


def states(store: Store, submission: str) -> list[str]:
    """Of its jobs, in the order of their scenarios."""
    return [job.state for job in rows(store, submission)]


def check_scored_once(store: Store, settings: ServerSettings, submission: str, jobs_expected: int) -> None:
    """Every row has the only right result, was told of once, and the summary is that of an undisturbed run."""
    found = rows(store, submission)
    assert len(found) == jobs_expected
    assert {job.state for job in found} == {JobState.DONE}
    for job in found:
        assert job.result == scored(job.scenario).model_dump(mode="json")
        recorded = settings.recordings / submission / "0" / f"{job.scenario}.npz"
        assert recorded.read_text() == f"recorded in attempt {job.attempt}"
    with store.read() as session:
        told = Counter(
            event.data["scenario"]
            for event in session.query(EventRow).filter(EventRow.submission == submission, EventRow.kind == "scenario")
        )
        done = [
            e
            for e in session.query(AuditEntryRow)
            if e.action == "submission-done" and e.data["submission"] == submission
        ]
        assert audit.verify_chain(session).broken is None
    assert set(told.values()) == {1}
    assert len(told) == jobs_expected
    assert len(done) == 1
    assert read(store, submission).summary == dict(summarise(found))


def calls(data: Path) -> int:
    """How many jobs have begun."""
    path = data / "calls"
    return len(path.read_text().splitlines()) if path.exists() else 0


def drive_through_kills(store: Store, settings: ServerSettings, submission: list[str], kills: int, seed: int) -> int:
    """Kills a worker, or its child, whenever some more jobs have begun; returns how many were killed."""
    dice, killed, begun = random.Random(seed), 0, 0
    with supervised(store, settings) as service:
        while not all(read(store, one).state == SubmissionState.DONE for one in submission):
            assert {read(store, one).state for one in submission} <= {
                SubmissionState.QUEUED,
                SubmissionState.RUNNING,
                SubmissionState.DONE,
            }
            time.sleep(dice.uniform(0.05, 0.3))
            pids = [*service.pids, *(child for pid in service.pids for child in children(pid))]
            if pids and killed < kills and calls(settings.data) > begun:
                begun = calls(settings.data)
                with suppress(ProcessLookupError):
                    os.kill(dice.choice(pids), signal.SIGKILL)
                    killed += 1
    return killed


def children(pid: int) -> list[int]:
    """Of all its threads."""
    found: list[int] = []
    for task in Path(f"/proc/{pid}/task").glob("*/children"):
        with suppress(FileNotFoundError, ProcessLookupError):
            found += [int(one) for one in task.read_text().split()]
    return found


def quietly_done(store: Store, submission: str) -> bool:
    """Whether it is done; False too where the database does not answer."""
    try:
        return read(store, submission).state == SubmissionState.DONE
    except StoreUnavailable:
        return False


def url(store: Store) -> str:
    """Of its database, as settings want it."""
    return store.url.render_as_string(hide_password=False).replace("+psycopg", "")


@contextmanager
def served(settings: ServerSettings) -> Generator[subprocess.Popen[bytes]]:
    """A process that has a supervisor, as `serve` has."""
    command = [sys.executable, "-c", SERVER, settings.model_dump_json()]
    with subprocess.Popen(command, env=os.environ | {"PYTHONPATH": str(TESTS)}) as process:
        try:
            yield process
        finally:
            process.kill()


SERVER = """
import sys, time
from server import phase_suites
from server.settings import ServerSettings
from server.store import Store
from testing import evaluation_fakes, evaluation_real
phase_suites.compute_code_checksum = evaluation_fakes.steady
settings = ServerSettings.model_validate_json(sys.argv[1])
with evaluation_real.supervised(Store(settings.database_url), settings):
    time.sleep(600)
"""
