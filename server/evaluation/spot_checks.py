"""Spot checks: finished scenarios run again. The simulation is deterministic, so a difference is a fault.

The fault is ours, or the agent is not deterministic (clock, machine load, unseeded randomness).
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
from server.enums import JobState, ScenarioVerdict, SubmissionState
from server.evaluation.job_task import AgentRejection, JobResult, JobTask, load_task
from server.phase_suites import LoadedPhaseSuites, PhaseSuites
from server.settings import ServerSettings
from server.store import Store, audit, jobs, phases, submissions
from server.store.tables import JobRow, SubmissionRow

LOG = logging.getLogger("mdrive.worker")
SAMPLE_SIZE = 1
"""Scenarios of a submission that are run again."""
LIMIT_S = 3600.0


@dataclass(frozen=True, slots=True)
class SpotCheck:
    """Result of a spot check."""

    submission: str
    scenario: str
    seed: int
    same: bool
    text: str


def is_drawn(draw: str, share: float) -> bool:
    """Return whether a submission belongs to that share of all.

    `draw`: head of the audit log after the submission's end. It is unknown while the submission can still be cancelled,
    and the audit log lets anyone verify the draw afterwards.
    """
    return int(draw[:8], 16) < share * 2**32


def sample_jobs(session: Session, submission: str, draw: str, size: int = SAMPLE_SIZE) -> Sequence[JobRow]:
    """Return finished jobs without agent failures (time-outs are not reproducible), chosen by `draw`."""
    finished = select(JobRow).where(
        JobRow.submission == submission,
        JobRow.state == JobState.DONE,
        JobRow.verdict == ScenarioVerdict.OK,
        JobRow.result.is_not(None),  # its retention period may be over
    )

    def place(job: JobRow) -> bytes:
        return hashlib.sha256(f"{draw} {submission} {job.scenario} {job.seed}".encode()).digest()

    return sorted(session.scalars(finished), key=place)[:size]


def make_check_task(store: Store, job_id: int, settings: ServerSettings, suites: PhaseSuites) -> JobTask:
    """Return the task that runs a job again without storing files. Raises NotFound."""
    with store.read() as session:
        job = jobs.get(session, job_id)
        again = load_task(session, job, settings, suites)
    return replace(again, public=False, attempt=-os.getpid())  # a stage folder of its own


def record_outcome(store: Store, job_id: int, outcome: JobResult | WorkerFailure, now_us: int) -> SpotCheck | None:
    """Compare the outcome and write the result to the audit log; return None if the job could not be run."""
    if isinstance(outcome, WorkerFailure):
        LOG.warning("spot check of job %d: %s", job_id, outcome.reason)
        return None
    with store.write() as session:
        job = jobs.get(session, job_id)
        found = _compare(job, outcome)
        entry = {"submission": found.submission, "job": job.id, "same": found.same, "text": found.text}
        audit.add_entry(session, "server", "spot-check", entry, now_us)
    if not found.same:
        LOG.error("spot check of job %d, submission %s: %s", job_id, found.submission, found.text)
    return found


def run_spot_checks(
    store: Store,
    settings: ServerSettings,
    chosen: Sequence[str],
    clock: Callable[[], int],
    function: Callable[[JobTask], JobResult],
) -> Iterator[SpotCheck]:
    """Run spot checks of these submissions in worker processes, for the command line. Raises NotFound.

    Skips what cannot be run or was run by another evaluator.
    """
    suites = LoadedPhaseSuites(settings)
    with store.read() as session:
        draw = audit.find_head(session)
        ids = [
            job.id for one in chosen if _is_comparable(session, one, suites) for job in sample_jobs(session, one, draw)
        ]
    tasks = [make_check_task(store, job_id, settings, suites) for job_id in ids]
    with ProcessPool[JobTask, JobResult](function, max(1, min(settings.work.processes, len(tasks))), LIMIT_S) as pool:
        for done, outcome in pool.run(tasks):
            found = record_outcome(store, done.job, outcome, clock())
            if found is not None:
                yield found


def list_finished(session: Session, most: int) -> Sequence[str]:
    """Return the latest submissions that are done, for `run_spot_checks`."""
    done = (
        select(SubmissionRow.id)
        .where(SubmissionRow.state == SubmissionState.DONE)
        .order_by(SubmissionRow.finished_us.desc())
    )
    return session.scalars(done.limit(most)).all()


def _is_comparable(session: Session, submission: str, suites: PhaseSuites) -> bool:
    found = submissions.get(session, submission)
    same = found.evaluator == suites.evaluator(phases.get(session, found.phase), found.environment)
    if not same:
        LOG.warning(
            "submission %s: run by another version of code, suite, sandbox or environment: not compared", submission
        )
    return same


def _compare(job: JobRow, outcome: JobResult) -> SpotCheck:
    same, text = True, "identical"
    if isinstance(outcome, AgentRejection):
        same, text = False, f"rejected this time: {outcome.why}"
    elif outcome.reason is not None:
        same, text = False, f"its agent failed this time: {outcome.reason}"
    elif outcome.result != job.result:
        same, text = False, _describe_difference(job.result or {}, outcome.result or {})
    return SpotCheck(job.submission, job.scenario, job.seed, same, text)


def _describe_difference(then: dict[str, Any], now: dict[str, Any]) -> str:
    name = next(name for name in ("digest", "ticks", "ds", *then) if then.get(name) != now.get(name))
    return f"{name} {str(now.get(name))[:80]}, was {str(then.get(name))[:80]}"
