"""A service is stopped, killed, cancelled; its disk fills, its database restarts, its cluster dies."""

import os
import shutil
import signal
import subprocess
import time
from collections.abc import Generator
from contextlib import contextmanager, suppress
from pathlib import Path

import psycopg
import pytest
from testing import databases
from testing.dask_cluster import cluster
from testing.evaluation_fakes import LEASE_S, challenge, fast_clock, read, submitted
from testing.evaluation_real import (
    calls,
    check_scored_once,
    children,
    quietly_done,
    rows,
    served,
    supervised,
    url,
    wait_for,
)
from testing.processes import alive

from server.clock import DAY_US
from server.enums import JobState, SubmissionState
from server.evaluation.worker import NICE
from server.settings import ServerSettings
from server.store import Store, submissions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("steady_code")]


def with_database(settings: ServerSettings, store: Store) -> ServerSettings:
    return settings.model_copy(update={"database": url(store)})


@pytest.mark.full
def test_a_stop_gives_back_running_jobs_and_blames_no_agent(tmp_path: Path) -> None:
    store = databases.emptied("sqlite")
    settings = with_database(challenge(tmp_path, store, "hang", "hang"), store)
    submission = submitted(store, settings, fast_clock())
    with supervised(store, settings) as supervisor:
        mark = tmp_path / "s0.tried"
        wait_for(lambda: mark.exists() and mark.read_text() != "")
        child, began = int(mark.read_text()), time.monotonic()
        assert os.getpriority(os.PRIO_PROCESS, child) == os.getpriority(os.PRIO_PROCESS, 0) + NICE
        workers = supervisor.pids
    assert time.monotonic() - began < 10
    assert not any(alive(pid) for pid in (child, *workers))
    assert [(job.state, job.failures, job.owner) for job in rows(store, submission)] == [(JobState.QUEUED, 0, None)] * 2


@pytest.mark.full
def test_a_cancelled_submission_s_process_is_gone_within_a_heartbeat(tmp_path: Path) -> None:
    store = databases.emptied("sqlite")
    settings = with_database(challenge(tmp_path, store, "hang", "nap"), store)
    submission = submitted(store, settings, fast_clock())
    with supervised(store, settings) as supervisor:
        mark = tmp_path / "s0.tried"
        wait_for(lambda: mark.exists() and mark.read_text() != "")
        child, workers = int(mark.read_text()), supervisor.pids
        with store.write() as session:
            submissions.cancel(session, submission, fast_clock())
        wait_for(lambda: not alive(child))  # its heartbeat comes every half second of ours
        mark.unlink()
        other = submitted(store, settings, fast_clock())
        wait_for(mark.exists)  # its worker lives on, and drives the next one
        assert supervisor.pids == workers
        with store.write() as session:
            submissions.cancel(session, other, fast_clock())
    assert read(store, submission).state == SubmissionState.CANCELLED
    assert {job.failures for job in rows(store, submission)} == {0}


@pytest.mark.full  # in `make test`: test_fault_injection, whose workers are killed, and leases that end
def test_everything_killed_at_once_loses_nothing(tmp_path: Path) -> None:
    store = databases.emptied("sqlite")
    settings = with_database(challenge(tmp_path, store, *["nap"] * 2, "hang once", lease_s=LEASE_S), store)
    work = settings.work.model_copy(update={"processes": 1})  # each takes seconds to start
    settings = settings.model_copy(update={"work": work})
    submission = submitted(store, settings, fast_clock())
    with served(settings) as server:
        wait_for((tmp_path / "s2.tried").exists)
        workers = children(server.pid)
        # Beside the worker, the server has one supervisor for the boxes that it tried at its start.
        programs = [Path(f"/proc/{pid}/cmdline").read_bytes() for pid in workers]
        assert sum(b"stat_supervisor.py" not in program for program in programs) == 1 and len(workers) <= 2
        # The server last: its end would have the workers give their jobs back.
        for pid in (*(child for worker in workers for child in children(worker)), *workers, server.pid):
            with suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
        server.wait()
    assert read(store, submission).state == SubmissionState.RUNNING
    with supervised(store, settings):
        wait_for(lambda: read(store, submission).state == SubmissionState.DONE)
    check_scored_once(store, settings, submission, 3)
    assert sum(job.failures for job in rows(store, submission)) >= 1  # a lease that ended is a failure of ours


@pytest.mark.full
def test_a_database_that_restarts_in_mid_run(tmp_path: Path) -> None:
    """PostgreSQL ends all connections and recovers when one of its processes is killed."""
    store = databases.emptied("postgresql")
    settings = with_database(challenge(tmp_path, store, *["nap"] * 120, lease_s=LEASE_S), store)
    submission = submitted(store, settings, fast_clock())
    with supervised(store, settings):
        for done in (1, 40, 80):
            wait_for(lambda done=done: calls(tmp_path) >= done, limit_s=60.0)
            _crash(url(store))
        wait_for(lambda: quietly_done(store, submission))
    check_scored_once(store, settings, submission, 120)
    # A claim that was written down, but whose answer was lost in the crash, is a failure of ours once its lease ends.
    assert sum(job.failures for job in rows(store, submission)) <= 3


def _crash(database: str) -> None:
    with suppress(psycopg.OperationalError), psycopg.connect(database) as connection:
        os.kill(connection.info.backend_pid, signal.SIGKILL)
        connection.execute("SELECT 1")


@pytest.mark.full
def test_a_disk_that_fills_in_mid_run(tmp_path: Path) -> None:
    with small_disk(tmp_path / "data", 100) as data:
        store = Store(f"sqlite:///{data / 'server.sqlite'}")
        store.migrate()
        settings = with_database(challenge(data, store, *["nap"] * 100, lease_s=LEASE_S), store)
        submission = submitted(store, settings, fast_clock())
        with supervised(store, settings):
            wait_for(lambda: calls(data) > 0)
            fill(data / "filler")
            begun = calls(data)
            time.sleep(3.0)  # a minute of theirs
            assert read(store, submission).state in (SubmissionState.QUEUED, SubmissionState.RUNNING)
            assert calls(data) <= begun + 2  # each worker at most one more
            (data / "filler").unlink()
            wait_for(lambda: quietly_done(store, submission))
        check_scored_once(store, settings, submission, 100)
        assert read(store, submission).counts
        store.close()


def fill(filler: Path) -> None:
    """Until not a byte is left."""
    with filler.open("wb", buffering=0) as file, suppress(OSError):
        while True:
            file.write(bytes(4096))


@contextmanager
def small_disk(folder: Path, mebibytes: int) -> Generator[Path]:
    folder.mkdir()
    if os.geteuid() != 0:
        pytest.skip("needs root")
    command = ["mount", "-t", "tmpfs", "-o", f"size={mebibytes}m", "tmpfs", str(folder)]
    if shutil.which("mount") is None or subprocess.run(command, capture_output=True, check=False).returncode:
        pytest.skip("needs root")
    try:
        yield folder
    finally:
        subprocess.run(["umount", "--lazy", str(folder)], check=True)


@pytest.mark.full
def test_the_service_clears_up_by_itself(tmp_path: Path) -> None:
    store = databases.emptied("sqlite")
    settings = with_database(challenge(tmp_path, store, "nap", "hang"), store)
    running = submitted(store, settings, fast_clock())
    long_ago = fast_clock() - 1000 * DAY_US
    forgotten = submitted(store, settings, long_ago)
    with store.write() as session:
        submissions.cancel(session, forgotten, long_ago)
    needed, old = (read(store, one).archive_sha256 for one in (running, forgotten))
    for name in (f"archives/{needed}.zip", f"archives/{old}.zip", f"recordings/{forgotten}/0/s0.npz"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    for name in (f"unpacked/{needed}", f"unpacked/{old}"):
        (tmp_path / name).mkdir(parents=True)
        os.utime(tmp_path / name, (0, 0))
    with supervised(store, settings):
        wait_for(lambda: not (tmp_path / "unpacked" / old).exists())
        wait_for((tmp_path / "recordings" / running / "0" / "s0.npz").exists)
    left = {str(path.relative_to(tmp_path)) for path in tmp_path.glob("[aru]*/*")}
    assert left == {f"archives/{needed}.zip", f"recordings/{running}", f"unpacked/{needed}"}


@pytest.mark.timeout(600)
@pytest.mark.full
def test_a_service_on_a_cluster_outlives_its_scheduler(tmp_path: Path) -> None:
    store = databases.emptied("sqlite")
    (tmp_path / "dask").mkdir()
    with cluster(tmp_path / "dask") as own:
        settings = with_database(challenge(tmp_path, store, *["nap"] * 60, "hang once", *["nap"] * 20), store)
        work = settings.work.model_copy(update={"scheduler": own.address})
        settings = settings.model_copy(update={"work": work})
        submission = submitted(store, settings, fast_clock())
        with supervised(store, settings) as supervisor:
            wait_for((tmp_path / "s60.tried").exists)
            assert len(supervisor.pids) == 1  # the dispatcher
            own.kill_scheduler()
            wait_for(lambda: {job.state for job in rows(store, submission)} == {JobState.DONE, JobState.QUEUED})
            own.start(2)
            wait_for(lambda: read(store, submission).state == SubmissionState.DONE, limit_s=180.0)
        check_scored_once(store, settings, submission, 81)
        assert {job.failures for job in rows(store, submission)} == {0}
