"""The worker pool: whatever happens to a worker, every job ends with a result or a reason."""

import os
import signal
import subprocess
import sys
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
from testing import processes
from testing.paths import TESTS
from testing.processes import alive, find_parent, written

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.roads import list_packaged_networks
from mdrive_sumo.roads.network_file import NET_FILE
from mdrive_sumo.runs.evaluate import run_with_retries
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure, count_available_cores
from mdrive_sumo.runs.worker_process import WorkerProcess

pytestmark = pytest.mark.slow

wait_for = partial(processes.wait_for, limit_s=60.0)


@pytest.fixture
def fakes(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(str(TESTS))
    from testing import pool_fakes

    return pool_fakes


def run(fakes: ModuleType, *deeds: str, workers: int = 1, limit_s: float = 60.0, folder: str = "") -> list[Any]:
    tasks = [fakes.Task(f"{i}", deed, folder) for i, deed in enumerate(deeds)]
    with ProcessPool(fakes.perform, workers, limit_s) as pool:
        found = {task.name: outcome for task, outcome in pool.run(tasks)}
    return [found[task.name] for task in tasks]


def test_one_worker_serves_all_jobs(fakes: ModuleType) -> None:
    names, pids = zip(*(answer.split() for answer in run(fakes, "answer", "answer", "answer")), strict=True)
    assert names == ("0", "1", "2")
    assert len(set(pids)) == 1
    assert pids[0] != str(os.getpid())


def test_two_workers_share_the_jobs(fakes: ModuleType) -> None:
    answers = run(fakes, "nap", "nap", "nap", "nap", workers=2)
    assert len({answer.split()[1] for answer in answers}) == 2


@pytest.mark.parametrize(
    ("deed", "kind", "reason"),
    [
        ("kill", FailureKind.DIED, "the worker process was ended by SIGKILL"),
        ("segfault", FailureKind.DIED, "the worker process was ended by SIGSEGV"),
        ("leave", FailureKind.DIED, "the worker process ended with exit code 7"),
        ("raise", FailureKind.RAISED, "ZeroDivisionError in pool_fakes.py:"),
        ("input", FailureKind.INPUT, "the map: expected a road, found the sea"),
        ("world", FailureKind.RAISED, "SUMO lost the road"),
        ("full", FailureKind.INPUT, "the run folder: cannot be written: No space left on device"),
    ],
)
def test_a_failed_job_has_a_reason_and_the_next_one_a_result(
    fakes: ModuleType, deed: str, kind: FailureKind, reason: str
) -> None:
    failure, answer = run(fakes, deed, "answer")
    assert isinstance(failure, WorkerFailure)
    assert failure.kind is kind
    assert failure.reason.startswith(reason)
    assert "\n" not in failure.reason
    assert answer.startswith("1 ")


def test_a_hung_job_is_ended_with_all_that_it_started(fakes: ModuleType, tmp_path: Path) -> None:
    failure, answer = run(fakes, "hang with child", "answer", limit_s=2.0, folder=str(tmp_path))
    assert failure == WorkerFailure(FailureKind.HUNG, "hung: no result within 2 s")
    assert answer.startswith("1 ")
    child = int((tmp_path / "child").read_text())
    wait_for(lambda: not alive(child))


def test_a_hung_job_does_not_hold_up_the_other_worker(fakes: ModuleType) -> None:
    outcomes = run(fakes, "hang", "answer", "answer", "answer", workers=2, limit_s=2.0)
    assert [isinstance(outcome, WorkerFailure) for outcome in outcomes] == [True, False, False, False]


def test_workers_ignore_sigint(fakes: ModuleType) -> None:
    assert run(fakes, "interrupt self")[0].startswith("0 ")


def test_leaving_the_pool_ends_a_busy_worker(fakes: ModuleType, tmp_path: Path) -> None:
    tasks = [fakes.Task("quick"), fakes.Task("slow", "hang", str(tmp_path))]
    started = tmp_path / "slow.started"
    with ProcessPool(fakes.perform, 2, 60.0) as pool:
        next(pool.run(tasks))
        wait_for(lambda: written(started))
    assert not alive(int(started.read_text()))


def test_workers_are_forks_of_one_thread_without_a_simulation(fakes: ModuleType) -> None:
    from testing.simulating_fakes import describe_process

    net = str(list_packaged_networks()["avenue"] / NET_FILE)
    with ProcessPool(describe_process, 1, 60.0) as pool:
        drive = dict(pool.run([fakes.Task("drive", folder=net)])).popitem()[1]
        assert pool._server is not None
        second = WorkerProcess[Any, Any](pool._server)  # beside the one with a simulation
        second.start_job(fakes.Task("look"))
        wait_for(lambda: bool(second.pipe.poll(0.05)))
        look = second.poll_outcome()
        second.end()
    assert look == drive
    assert isinstance(look, tuple)
    assert look[1:] == (1, True, False)
    assert look[0] != os.getpid()


def test_a_dead_fork_server_ends_its_workers_and_is_replaced(fakes: ModuleType, tmp_path: Path) -> None:
    started = tmp_path / "hangs.started"
    with ProcessPool(fakes.perform, 1, 60.0) as pool:
        pool.submit("hangs", fakes.Task("hangs", "hang", str(tmp_path)))
        wait_for(lambda: written(started))
        os.kill(find_parent(int(started.read_text())), signal.SIGKILL)
        assert pool.collect_outcomes() == [
            ("hangs", WorkerFailure(FailureKind.DIED, "the worker process was ended by SIGKILL"))
        ]
        pool.submit("next", fakes.Task("next"))
        assert [(key, str(answer).split()[0]) for key, answer in pool.collect_outcomes()] == [("next", "next")]


PARENT = """
import sys
sys.path.insert(0, {here!r})
from testing import pool_fakes
from mdrive_sumo.runs.process_pool import ProcessPool
if __name__ == "__main__":
    with ProcessPool(pool_fakes.perform, 1, 600.0) as pool:
        list(pool.run([pool_fakes.Task("x", "hang", {folder!r})]))
"""


@pytest.mark.parametrize("sign", [signal.SIGKILL, signal.SIGTERM, signal.SIGINT])
def test_a_worker_dies_with_its_parent(tmp_path: Path, sign: signal.Signals) -> None:
    script = tmp_path / "parent.py"
    script.write_text(PARENT.format(here=str(TESTS), folder=str(tmp_path)))
    started = tmp_path / "x.started"
    with subprocess.Popen([sys.executable, str(script)], stderr=subprocess.DEVNULL) as parent:
        wait_for(lambda: written(started))
        parent.send_signal(sign)
    wait_for(lambda: not alive(int(started.read_text())))


def test_available_cores_respects_the_affinity() -> None:
    before = os.sched_getaffinity(0)
    try:
        os.sched_setaffinity(0, {min(before)})
        assert count_available_cores() == 1
    finally:
        os.sched_setaffinity(0, before)


def test_workers_that_cannot_start_stop_a_run_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """A module that only this process has stands for one that is missing in the environment of workers."""
    module = ModuleType("only_here")
    exec("def run(job): return job", module.__dict__)
    monkeypatch.setitem(sys.modules, "only_here", module)
    failed: list[int] = []
    with ProcessPool(module.run, 2, 60.0) as pool:
        sentence = "^worker processes cannot start: ModuleNotFoundError: No module named 'only_here'$"
        with pytest.raises(InputError, match=sentence):
            list(run_with_retries(pool, range(225), lambda job, reason, is_last: failed.append(job)))
    assert failed == []
