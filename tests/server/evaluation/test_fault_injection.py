"""Workers are killed at random, with the simulation faked: every job is scored exactly once, and nothing is lost."""

import sys
import time
from pathlib import Path

import pytest
from testing import databases, evaluation_fakes
from testing.evaluation_fakes import LEASE_S, challenge, fake, fast_clock, read, submitted
from testing.evaluation_real import (
    check_scored_once,
    count_spot_checks,
    drive_through_kills,
    rows,
    served,
    states,
    supervised,
    url,
    wait_for,
)
from testing.paths import TESTS
from testing.processes import alive

from mdrive_sumo.runs.make_executor import make_executor
from server.enums import JobState, SubmissionState
from server.evaluation.dispatcher import Dispatcher, StopRequest
from server.evaluation.supervisor import Supervisor
from server.phase_suites import LoadedPhaseSuites

pytestmark = pytest.mark.usefixtures("steady_code")


@pytest.mark.full
def test_killed_workers_lose_and_double_nothing(tmp_path: Path) -> None:
    store = databases.emptied("sqlite")
    settings = challenge(tmp_path, store, *["nap"] * 120, lease_s=LEASE_S).model_copy(update={"database": url(store)})
    work = settings.work.model_copy(update={"spot_check": 1.0})
    settings = settings.model_copy(update={"work": work})
    submission = submitted(store, settings, fast_clock())
    assert drive_through_kills(store, settings, [submission], kills=3, seed=1) == 3
    check_scored_once(store, settings, submission, 120)
    with supervised(store, settings):  # its spot check is a job, which the end of the workers has not lost
        wait_for(lambda: count_spot_checks(store) > 0)
        time.sleep(1.0)
    assert count_spot_checks(store) == 1


@pytest.mark.full
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("backend", "seed"), [*(("sqlite", seed) for seed in range(2, 7)), *((name, 2) for name in databases.BACKENDS[1:])]
)
def test_225_rows_survive_many_kills(tmp_path: Path, backend: str, seed: int) -> None:
    """Five runs of 20 kills are 100; each takes a minute or two."""
    store = databases.emptied(backend)
    settings = challenge(tmp_path, store, *["nap"] * 225, lease_s=LEASE_S).model_copy(update={"database": url(store)})
    both = [submitted(store, settings, fast_clock()) for _ in range(2)]
    assert drive_through_kills(store, settings, both, kills=20, seed=seed) == 20
    for submission in both:
        check_scored_once(store, settings, submission, 225)


@pytest.mark.full
def test_a_killed_server_takes_its_workers_along_and_the_next_goes_on(tmp_path: Path) -> None:
    store = databases.emptied("sqlite")
    settings = challenge(tmp_path, store, "nap", "hang once").model_copy(update={"database": url(store)})
    submission = submitted(store, settings, fast_clock())
    mark = tmp_path / "s1.tried"
    with served(settings) as server:
        wait_for(lambda: mark.exists() and mark.read_text() != "")
        wait_for(lambda: states(store, submission) == [JobState.DONE, JobState.RUNNING])
        child = int(mark.read_text())
        server.kill()
        server.wait()
        wait_for(lambda: not alive(child))
        wait_for(lambda: JobState.RUNNING not in states(store, submission))
    assert [job.failures for job in rows(store, submission)] == [0, 0]  # given back, not lost
    with supervised(store, settings):
        wait_for(lambda: read(store, submission).state == SubmissionState.DONE)
    check_scored_once(store, settings, submission, 2)


@pytest.mark.slow
def test_a_worker_that_dies_at_once_is_not_started_at_full_speed(tmp_path: Path) -> None:
    store = databases.emptied("sqlite")
    settings = evaluation_fakes.settings(tmp_path, processes=1)
    command = (sys.executable, "-c", f"open({str(tmp_path / 'starts')!r}, 'a').write('x')")
    supervisor = Supervisor(store, settings, command)
    supervisor.start()
    try:
        wait_for(lambda: (tmp_path / "starts").exists())
        time.sleep(2.0)
    finally:
        supervisor.stop()
    assert 1 <= len((tmp_path / "starts").read_text()) <= 3
    assert supervisor.pids == []


@pytest.mark.slow
def test_a_job_whose_worker_dies_each_time_fails_alone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With a real pool: the dispatcher outlives what it runs."""
    monkeypatch.syspath_prepend(str(TESTS))
    store = databases.emptied("sqlite")
    settings = challenge(tmp_path, store, "die once", "nap")
    submission = submitted(store, settings, fast_clock())
    stop = StopRequest()
    with make_executor(fake, 1, 60.0) as executor:
        dispatcher = Dispatcher(store, settings, LoadedPhaseSuites(settings), executor, "one", fast_clock)
        end = time.monotonic() + 60
        while read(store, submission).state != SubmissionState.DONE:
            assert time.monotonic() < end
            dispatcher.step(0.2, stop)
    stop.close()
    first, second = rows(store, submission)
    assert (first.attempt, first.failures, first.failure) == (2, 1, "died: the worker process was ended by SIGKILL")
    assert (second.attempt, second.failures) == (1, 0)
    check_scored_once(store, settings, submission, 2)
