"""A challenge with a fast clock, one dispatcher and an executor without processes. No tests in here."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.runs.executor import Executor, Waitable
from mdrive_sumo.runs.worker_process import FailureKind, WorkerFailure
from server.enums import JobKind
from server.evaluation.dispatcher import Dispatcher, StopRequest
from server.evaluation.job_task import JobResult, JobTask
from server.phase_suites import LoadedPhaseSuites
from server.settings import ServerSettings
from server.store import Store
from server.store.tables import AuditEntryRow, JobRow
from testing.evaluation_fakes import LEASE_S, challenge, fake, submitted

S = 1_000_000


class Inline:
    """An executor that does a job when it is asked for outcomes, and holds back those of scenarios in `stuck`."""

    def __init__(self, function: Callable[[JobTask], JobResult] = fake) -> None:
        self.function = function
        self.slots = 1
        self.waiting: dict[str, JobTask] = {}
        self.stuck: set[str] = set()
        self.ended: list[str] = []
        self.waits: list[float | None] = []

    @property
    def free_slots(self) -> int:
        return self.slots - len(self.waiting)

    def submit(self, key: str, job: JobTask) -> None:
        self.waiting[key] = job

    def collect_outcomes(
        self, timeout_s: float | None = None, also: Sequence[Waitable] = ()
    ) -> list[tuple[str, JobResult | WorkerFailure]]:
        self.waits.append(timeout_s)
        over = [(key, self._outcome(task)) for key, task in self.waiting.items() if task.scenario not in self.stuck]
        for key, _ in over:
            del self.waiting[key]
        return over

    def cancel(self, key: str) -> None:
        self.ended.append(key)
        self.waiting.pop(key, None)

    def _outcome(self, task: JobTask) -> JobResult | WorkerFailure:
        try:
            return self.function(task)
        except (RuntimeError, WorldError) as error:
            return WorkerFailure(FailureKind.RAISED, str(error))


class Bench:
    """A challenge, its database, and one dispatcher with a clock of its own."""

    def __init__(self, folder: Path, store: Store) -> None:
        self.folder, self.store = folder, store
        self.executor, self.stop = Inline(), StopRequest()
        self.now_us = 1000 * S
        self.settings = ServerSettings()

    def begin(self, *deeds: str, public: bool = True, **changed: Any) -> str:
        """One submission of a suite with these deeds."""
        self.settings = challenge(self.folder, self.store, *deeds, public=public, lease_s=LEASE_S)
        self.dispatcher = self.another("one")
        return submitted(self.store, self.settings, self.now_us, **changed)

    def another(self, owner: str, executor: Executor[JobTask, JobResult] | None = None) -> Dispatcher:
        executor = executor or self.executor
        suites = LoadedPhaseSuites(self.settings)
        return Dispatcher(self.store, self.settings, suites, executor, owner, lambda: self.now_us)

    def steps(self, count: int, pause_us: int = 0) -> None:
        for _ in range(count):
            self.dispatcher.step(0.0, self.stop)
            self.now_us += pause_us

    def rows(self) -> list[JobRow]:
        """The jobs of submissions."""
        with self.store.read() as session:
            return list(session.query(JobRow).filter_by(kind=JobKind.SUBMISSION).order_by(JobRow.id))

    def calls(self) -> int:
        path = self.settings.data / "calls"
        return len(path.read_text().splitlines()) if path.exists() else 0

    def spot_checks(self) -> list[dict[str, Any]]:
        """What the audit log tells of them."""
        with self.store.read() as session:
            return [
                one.data
                for one in session.query(AuditEntryRow).filter_by(action="spot-check").order_by(AuditEntryRow.id)
            ]

    def with_spot_checks(self) -> None:
        """Every submission from now on has one."""
        work = self.settings.work.model_copy(update={"spot_check": 1.0})
        self.settings = self.settings.model_copy(update={"work": work})
        self.dispatcher = self.another("one")
