"""Spot checks: finished results driven once more. The simulation repeats itself exactly, so a difference is a fault.

Of ours, or of an agent that does not do the same twice (the clock, the network's weather, unseeded randomness).
"""

import hashlib
import logging
import os
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from mdrive_sumo.runs.process_pool import ProcessPool
from mdrive_sumo.runs.worker_process import WorkerFailure
from server.enums import JobState, State, Verdict
from server.evaluation.job_task import Driven, JobTask, Rejection, task_of
from server.phase_suites import LoadedSuites, Suites
from server.settings import Settings
from server.store import Store, audit, jobs, phases, submissions
from server.store.tables import Job, Submission

LOG = logging.getLogger("mdrive.worker")
SAMPLE = 1
"""Scenarios of a submission that are driven again."""
LIMIT_S = 3600.0


@dataclass(frozen=True, slots=True)
class SpotCheck:
    """What came of it."""

    submission: str
    scenario: str
    seed: int
    same: bool
    text: str


def is_drawn(draw: str, share: float) -> bool:
    """Whether a submission is among that share of all.

    `draw`: head of the audit log with the submission's end in it. Nobody knows it while the submission can still be
    cancelled, and afterwards whoever has the log can tell that the draw was right.
    """
    return int(draw[:8], 16) < share * 2**32


def sample(session: Session, submission: str, draw: str, size: int = SAMPLE) -> Sequence[Job]:
    """Finished jobs without a failure of the agent (a time-out cannot be computed anew); which ones `draw` decides."""
    finished = select(Job).where(Job.submission == submission, Job.state == JobState.DONE, Job.verdict == Verdict.OK)

    def place(job: Job) -> bytes:
        return hashlib.sha256(f"{draw} {submission} {job.scenario} {job.seed}".encode()).digest()

    return sorted(session.scalars(finished), key=place)[:size]


def task(store: Store, job_id: int, settings: Settings) -> JobTask:
    """To drive it once more; no files are kept. Raises NotFound."""
    with store.read() as session:
        job = jobs.get(session, job_id)
        again = task_of(session, job, settings)
    return replace(again, public=False, attempt=-os.getpid())  # a stage of its own


def note(store: Store, job_id: int, outcome: Driven | WorkerFailure, now_us: int) -> SpotCheck | None:
    """Compares, and writes what was found into the audit log; None where it could not be driven."""
    if isinstance(outcome, WorkerFailure):
        LOG.warning("spot check of job %d: %s", job_id, outcome.reason)
        return None
    with store.write() as session:
        job = jobs.get(session, job_id)
        found = _compared(job, outcome)
        told = {"submission": found.submission, "job": job.id, "same": found.same, "text": found.text}
        audit.add(session, "server", "spot-check", told, now_us)
    if not found.same:
        LOG.error("spot check of job %d, submission %s: %s", job_id, found.submission, found.text)
    return found


def verify(
    store: Store,
    settings: Settings,
    chosen: Sequence[str],
    clock: Callable[[], int],
    function: Callable[[JobTask], Driven],
) -> Iterator[SpotCheck]:
    """Spot checks of these submissions now, in worker processes: for the command line. Raises NotFound.

    What cannot be driven, or was driven by another evaluator, is left out.
    """
    suites = LoadedSuites(settings)
    with store.read() as session:
        draw = audit.head(session)
        ids = [job.id for one in chosen if _comparable(session, one, suites) for job in sample(session, one, draw)]
    tasks = [task(store, job_id, settings) for job_id in ids]
    with ProcessPool[JobTask, Driven](function, max(1, min(settings.work.processes, len(tasks))), LIMIT_S) as pool:
        for done, outcome in pool.run(tasks):
            found = note(store, done.job, outcome, clock())
            if found is not None:
                yield found


def finished(session: Session, most: int) -> Sequence[str]:
    """The latest submissions that are done, for `verify`."""
    done = select(Submission.id).where(Submission.state == State.DONE).order_by(Submission.finished_us.desc())
    return session.scalars(done.limit(most)).all()


def _comparable(session: Session, submission: str, suites: Suites) -> bool:
    found = submissions.get(session, submission)
    same = found.evaluator == suites.evaluator(phases.get(session, found.phase), found.environment)
    if not same:
        LOG.warning(
            "submission %s: driven by another version of code, suite, sandbox or environment: not compared", submission
        )
    return same


def _compared(job: Job, outcome: Driven) -> SpotCheck:
    same, text = True, "identical"
    if isinstance(outcome, Rejection):
        same, text = False, f"rejected this time: {outcome.why}"
    elif outcome.reason is not None:
        same, text = False, f"its agent failed this time: {outcome.reason}"
    elif outcome.result != job.result:
        same, text = False, _difference(job.result or {}, outcome.result or {})
    return SpotCheck(job.submission, job.scenario, job.seed, same, text)


def _difference(then: dict[str, Any], now: dict[str, Any]) -> str:
    name = next(name for name in ("digest", "ticks", "ds", *then) if then.get(name) != now.get(name))
    return f"{name} {str(now.get(name))[:80]}, was {str(then.get(name))[:80]}"
