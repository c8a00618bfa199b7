"""Executors: the pool, and a real Dask cluster; the same outcomes, whoever dies."""

import importlib
import os
import signal
import threading
import time
from collections.abc import Generator
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from testing import databases, processes
from testing.dask_cluster import Cluster, cluster
from testing.evaluation_fakes import challenge, fake, fast_clock, scored, submitted
from testing.local_executor import run_in_process
from testing.paths import TESTS
from testing.processes import alive, find_parent, written
from testing.short_suite import make_short_suite

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.runs.evaluate import evaluate
from mdrive_sumo.runs.executor import Executor, run_jobs
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.process_pool import ProcessPool
from mdrive_sumo.runs.result_transfer import run_with_output_files, store_output_files
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.runs.worker_process import FailureKind, WorkerFailure, WorkerProcess, make_fork_server
from mdrive_sumo.scoring import ScenarioResult
from server.evaluation.dispatcher import Dispatcher, StopRequest
from server.phase_suites import LoadedPhaseSuites
from server.store.tables import JobRow as Job_

pytestmark = pytest.mark.costly_fixture

wait_for = partial(processes.wait_for, limit_s=60.0)


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(TESTS))
    return importlib.import_module("testing.pool_fakes")


@pytest.fixture(scope="module")
def two_workers(tmp_path_factory: pytest.TempPathFactory) -> Generator[Cluster]:
    with cluster(tmp_path_factory.mktemp("dask")) as found:
        yield found


def opened(fakes: ModuleType, scheduler: str = "", workers: int = 2, limit_s: float = 120.0) -> Any:
    return make_executor(fakes.perform, workers, limit_s, scheduler)


def names(executor: Executor[Any, str], tasks: list[Any]) -> dict[str, str]:
    return {
        task.name: outcome.kind if isinstance(outcome, WorkerFailure) else outcome.split()[0]
        for task, outcome in run_jobs(executor, tasks)
    }


def test_an_ended_job_is_gone_with_its_worker_and_has_no_outcome(fakes: ModuleType, tmp_path: Path) -> None:
    with ProcessPool[Any, str](fakes.perform, 2, 60.0) as pool:
        pool.submit("slow", fakes.Task("slow", "hang", str(tmp_path)))
        wait_for(lambda: written(tmp_path / "slow.started"))
        assert pool.free_slots == 1
        pool.cancel("slow")
        assert pool.free_slots == 2
        assert not alive(int((tmp_path / "slow.started").read_text()))
        pool.submit("quick", fakes.Task("quick"))
        assert [key for key, _ in pool.collect_outcomes()] == ["quick"]
        pool.cancel("quick")  # too late: nothing happens


@pytest.mark.slow
def test_a_worker_that_dies_while_it_answers_is_a_dead_worker(fakes: ModuleType, tmp_path: Path) -> None:
    server = make_fork_server(fakes.dies_answering)
    hand = WorkerProcess[Any, bytes](server)
    hand.start_job(fakes.Task("x", folder=str(tmp_path)))
    started = tmp_path / "x.started"
    wait_for(lambda: written(started) and not alive(int(started.read_text())))
    outcome = hand.poll_outcome()
    assert isinstance(outcome, WorkerFailure)
    assert (outcome.kind, outcome.reason) == (FailureKind.DIED, "the worker process was ended by SIGKILL")
    assert not hand.is_usable
    server.end()


def test_waiting_ends_for_something_else_to_read_and_with_the_time(fakes: ModuleType) -> None:
    reading, writing = os.pipe()
    try:
        with ProcessPool[Any, str](fakes.perform, 1, 60.0) as pool:
            pool.submit("slow", fakes.Task("slow", "hang"))
            assert pool.collect_outcomes(0.01) == []
            threading.Timer(0.1, lambda: os.write(writing, b".")).start()
            since = time.monotonic()
            assert pool.collect_outcomes(30.0, [reading]) == []
            assert time.monotonic() - since < 20
    finally:
        os.close(reading)
        os.close(writing)


@pytest.mark.slow
def test_no_scheduler_is_one_sentence(monkeypatch: pytest.MonkeyPatch, fakes: ModuleType) -> None:
    monkeypatch.setattr("mdrive_sumo.runs.dask_executor.CONNECT_S", 0.5)
    with pytest.raises(InputError, match=r"^--scheduler tcp://127.0.0.1:1: no Dask scheduler answers there"):
        opened(fakes, "tcp://127.0.0.1:1")


@pytest.mark.parametrize(
    "address", ["here", "10.0.0.1:8786", "tcp://here", "ucx://10.0.0.1:8786", "tcp://a b:1", "tcp://::1:1"]
)
def test_what_is_no_address_is_said_at_once(fakes: ModuleType, address: str) -> None:
    with pytest.raises(InputError, match=r"^--scheduler: expected tcp://HOST:PORT of a Dask scheduler, found '"):
        opened(fakes, address)


def test_without_dask_one_is_told_what_to_install(fakes: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("importlib.util.find_spec", lambda _: None)
    with pytest.raises(InputError, match=r"^--executor dask: expected the package distributed, found none; pip "):
        opened(fakes, "tcp://127.0.0.1:1")


@pytest.mark.full
@pytest.mark.slow
def test_a_cluster_gives_the_outcomes_of_the_pool(fakes: ModuleType, two_workers: Cluster) -> None:
    deeds = ("answer", "raise", "kill", "input", "nap", "world", "segfault", "answer")
    tasks = [fakes.Task(str(i), deed) for i, deed in enumerate(deeds)]
    with opened(fakes) as pool, opened(fakes, two_workers.address) as dask:
        assert names(dask, tasks) == names(pool, tasks)


@pytest.mark.slow
def test_a_cluster_works_in_children_of_its_workers_at_once(fakes: ModuleType, two_workers: Cluster) -> None:
    with opened(fakes, two_workers.address) as dask:
        wait_for(lambda: dask.free_slots == 2)
        found = [outcome for _, outcome in run_jobs(dask, [fakes.Task(str(i), "nap") for i in range(6)])]
    pids = {int(str(outcome).split()[1]) for outcome in found}
    assert len(pids) == 2  # each thread keeps its child
    assert not pids & {worker.pid for worker in two_workers.workers}


@pytest.mark.full
def test_a_hung_and_an_ended_job_of_a_cluster_are_killed(
    fakes: ModuleType, two_workers: Cluster, tmp_path: Path
) -> None:
    with opened(fakes, two_workers.address, limit_s=20.0) as dask:
        dask.submit("ended", fakes.Task("ended", "hang", str(tmp_path)))
        dask.submit("hung", fakes.Task("hung", "hang", str(tmp_path)))
        pids = [tmp_path / "ended.started", tmp_path / "hung.started"]
        wait_for(lambda: all(map(written, pids)))
        dask.cancel("ended")
        wait_for(lambda: not alive(int(pids[0].read_text())))
        assert dask.collect_outcomes() == [("hung", WorkerFailure(FailureKind.HUNG, "hung: no result within 20 s"))]
        wait_for(lambda: not alive(int(pids[1].read_text())))


@pytest.mark.slow
def test_other_code_is_refused(fakes: ModuleType, two_workers: Cluster, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mdrive_sumo.runs.dask_executor._read_code_state", lambda: {"code": "sha256:other"})
    with opened(fakes, two_workers.address) as dask:
        [(_, outcome)] = run_jobs(dask, [fakes.Task("x")])
    assert outcome.kind is FailureKind.INPUT
    assert outcome.reason.startswith("a worker of Dask: expected the same code as here, found code sha256:")


@pytest.mark.full
def test_jobs_outlive_a_worker_of_a_cluster_and_not_its_scheduler(fakes: ModuleType, tmp_path: Path) -> None:
    with cluster(tmp_path) as own, opened(fakes, own.address) as dask:
        wait_for(lambda: dask.free_slots == 2)
        dask.submit("a", fakes.Task("a", "hang once", str(tmp_path)))
        wait_for(lambda: written(tmp_path / "a.started"))
        child = int((tmp_path / "a.started").read_text())
        os.killpg(_worker_of(child, own), signal.SIGKILL)
        wait_for(lambda: not alive(child))
        assert [key for key, _ in dask.collect_outcomes(60.0)] == ["a"]  # the other worker did it
        dask.submit("b", fakes.Task("b", "hang", str(tmp_path)))
        wait_for(lambda: written(tmp_path / "b.started"))
        own.kill_scheduler()
        from mdrive_sumo.runs.dask_executor import ExecutorLostError  # only here: every process collects this module

        with pytest.raises(ExecutorLostError, match="is lost"):
            dask.collect_outcomes(60.0)
        wait_for(lambda: not alive(int((tmp_path / "b.started").read_text())), limit_s=90.0)


@pytest.mark.full
def test_a_worker_under_a_nanny_has_children_too(fakes: ModuleType, tmp_path: Path) -> None:
    with cluster(tmp_path, workers=0) as own:
        own.add_worker("--nanny")
        with opened(fakes, own.address) as dask:
            assert names(dask, [fakes.Task("x")]) == {"x": "x"}


def _worker_of(child: int, own: Cluster) -> int:
    worker = find_parent(find_parent(child))  # between them is the fork server of one thread of the worker
    assert worker in {worker.pid for worker in own.workers}
    return worker


def test_a_job_s_files_come_back_with_its_result(tmp_path: Path) -> None:
    def writes(job: EpisodeJob) -> ScenarioResult:
        assert job.recording and job.logs and job.transcripts
        job.recording.write_text("episode")
        (job.logs / "s0.log").write_text("printed")
        job.transcripts.mkdir()
        (job.transcripts / "s0.jsonl").write_text("said")
        assert not job.recording.is_relative_to(tmp_path)
        return scored("s0")

    home = tmp_path / "run"
    job = EpisodeJob(
        Path(), "s0", AgentSpec("idm"), recording=home / "e.npz", logs=home / "logs", transcripts=home / "t"
    )
    carried = run_with_output_files(writes, job)
    assert not home.exists()
    assert store_output_files(job, carried) == scored("s0")
    found = {str(path.relative_to(home)): path.read_text() for path in home.rglob("*") if path.is_file()}
    assert found == {"e.npz": "episode", "logs/s0.log": "printed", "t/s0.jsonl": "said"}


@pytest.mark.full  # in `make test`: the outcomes of the pool, with jobs that do not drive
@pytest.mark.timeout(900)
def test_eval_on_a_cluster_gives_the_same_bytes(
    two_workers: Cluster, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With real simulations; the recordings too."""
    suite = str(make_short_suite(tmp_path / "suite", "i0[12]*"))

    def evaluated(name: str, scheduler: str) -> dict[str, bytes]:
        out = tmp_path / name
        settings = RunConfig(suite, agent=AgentSpec("idm"), workers=1, scheduler=scheduler, out=out)
        results = evaluate(prepare(settings), Quiet())
        assert results.void == 0
        return {path.name: path.read_bytes() for path in [out / "results.json", *sorted((out / "episodes").iterdir())]}

    dask = evaluated("dask", two_workers.address)
    run_in_process(monkeypatch)
    local = evaluated("local", "")
    assert len(local) == 3
    assert local == dask


class Quiet:
    def begin(self, total: int, kept: object) -> None: ...
    def done(self, result: ScenarioResult) -> None: ...
    def show_running(self, running: object) -> None: ...
    def note(self, text: str) -> None:
        raise AssertionError(text)


@pytest.mark.full
def test_the_server_on_a_cluster_scores_once_and_gives_back_what_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.syspath_prepend(str(TESTS))
    store, stop = databases.emptied("sqlite"), StopRequest()
    deeds = ["nap", "die once", "hang once", *["nap"] * 12, "hang"]  # the last starts when all others are done
    options = challenge(tmp_path, store, *deeds)
    submission = submitted(store, options, fast_clock())
    (tmp_path / "dask").mkdir()
    with cluster(tmp_path / "dask") as own, make_executor(fake, 1, 120.0, own.address) as executor:
        dispatcher = Dispatcher(store, options, LoadedPhaseSuites(options), executor, "one", fast_clock)
        tried = tmp_path / "s2.tried"
        while not written(tried):
            dispatcher.step(0.2, stop)
        os.killpg(_worker_of(int(tried.read_text()), own), signal.SIGKILL)
        last = tmp_path / "s15.tried"
        while not written(last):
            dispatcher.step(0.2, stop)
        child = int(last.read_text())
        own.kill_scheduler()
        from mdrive_sumo.runs.dask_executor import ExecutorLostError

        with pytest.raises(ExecutorLostError):
            dispatcher.run(stop)
        wait_for(lambda: not alive(child), limit_s=90.0)
    stop.close()
    with store.read() as session:
        rows = session.query(Job_).filter(Job_.submission == submission).order_by(Job_.id).all()
    assert [row.state for row in rows] == ["done"] * 15 + ["queued"]
    assert [row.failures for row in rows] == [0, 1, *[0] * 14]
    assert all(row.result == scored(row.scenario).model_dump(mode="json") for row in rows[:15])
