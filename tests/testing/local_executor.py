"""Runs and studies without worker processes, which take seconds to start: for tests whose subject they are not."""

from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib import import_module
from typing import Any, Generic, TypeVar

import pytest

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.runs import worker_process
from mdrive_sumo.runs.executor import run_jobs
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.runs.process_pool import ProcessPool
from mdrive_sumo.runs.worker_process import WorkerFailure
from testing.study_talker import Talker

J = TypeVar("J")
R = TypeVar("R")
TALKER = "talker"
"""Name of `study_talker.Talker` as a built-in agent: it drives without processes."""


class LocalExecutor(Generic[J, R]):
    """A ProcessPool whose jobs run in this process, with failures described as by a worker."""

    def __init__(self, function: Callable[[J], R], *_: object) -> None:
        self._function = function
        self._done: list[tuple[str, R | WorkerFailure]] = []

    def __enter__(self) -> "LocalExecutor[J, R]":
        return self

    def __exit__(self, *_: object) -> None:
        """There is nothing to end."""

    @property
    def free_slots(self) -> int:
        """One worker, which has a new job when its last outcome is collected."""
        return 0 if self._done else 1

    def submit(self, key: str, job: J) -> None:
        self._done.append((key, worker_process.run_job_guarded(self._function, job)))

    def collect_outcomes(self, *_: object) -> list[tuple[str, R | WorkerFailure]]:
        done, self._done = self._done, []
        return done

    def cancel(self, key: str) -> None:
        """A job is finished as soon as it is submitted."""

    def run(self, jobs: Iterable[J]) -> Iterator[tuple[J, R | WorkerFailure]]:
        return run_jobs(self, jobs)


def run_in_workers(patch: pytest.MonkeyPatch) -> None:
    """Undo `run_in_process` for `evaluate` and `verify`."""
    patch.setattr("mdrive_sumo.runs.evaluate.make_executor", make_executor)
    patch.setattr("mdrive_sumo.runs.verify.ProcessPool", ProcessPool)


def run_in_process(patch: pytest.MonkeyPatch) -> None:
    """Make `evaluate`, `evaluate_open`, `verify`, `ablate`, `validate` and `generate --hard` drive in this process.

    `Talker` becomes a built-in agent.
    """
    patch.setattr("mdrive_sumo.runs.evaluate.make_executor", LocalExecutor)
    patch.setattr(import_module("mdrive_sumo.open_loop.evaluate_open"), "make_executor", LocalExecutor)
    for module in (
        "runs.verify",
        "study.ablation",
        "generate.validation.scenario_validation",
        "generate.hard.adversarial_search",
        "generate.hard.hard_places",
        "generate.hard.hard_suite",
    ):
        patch.setattr(f"mdrive_sumo.{module}.ProcessPool", LocalExecutor)
    agents: Mapping[str, Any] = {**AGENTS, TALKER: Talker}
    for module in ("runs.open_agents", "runs.agent_spec"):
        patch.setattr(f"mdrive_sumo.{module}.AGENTS", agents)
