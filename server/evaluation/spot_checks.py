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

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.process_pool import ProcessPool
from mdrive_sumo.runs.worker_process import WorkerFailure
from server.enums import JobKind, JobState, ScenarioVerdict, SubmissionState
from server.evaluation.job_task import AgentRejection, JobResult, JobTask, describe_failure, load_task
from server.phase_suites import LoadedPhaseSuites, PhaseSuites
from server.settings import ServerSettings
from server.store import Store, audit, submissions
from server.store.tables import JobRow, SubmissionRow

LOG = logging.getLogger("mdrive.worker")
SAMPLE_SIZE = 1
"""Scenarios of a submission that are run again."""
LIMIT_S = 3600.0
"""Wall time after which a check of `mdrive-sumo admin verify` counts as hanging [s]."""
NOT_COMPARED = "run by another version of code, suite, sandbox or environment: not compared"


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


def plan_check(session: Session, submission: str, share: float) -> None:
    """Queue the spot checks of a submission that has just been done, if it is one of those that are drawn."""
    draw = audit.find_head(session)
    if is_drawn(draw, share):
        session.add_all(
            JobRow(
                kind=JobKind.SPOT_CHECK.value,
                submission=submission,
                others=submission,
                scenario=job.scenario,
                seed=job.seed,
                state=JobState.QUEUED.value,
            )
            for job in sample_jobs(session, submission, draw)
        )


def sample_jobs(session: Session, submission: str, draw: str, size: int = SAMPLE_SIZE) -> Sequence[JobRow]:
    """Return finished jobs without agent failures (time-outs are not reproducible), chosen by `draw`."""
    finished = select(JobRow).where(
        JobRow.is_of(submission),
        JobRow.state == JobState.DONE,
        JobRow.verdict == ScenarioVerdict.OK,
        JobRow.result.is_not(None),  # its retention period may be over
    )

    def place(job: JobRow) -> bytes:
        return hashlib.sha256(f"{draw} {submission} {job.scenario} {job.seed}".encode()).digest()

    return sorted(session.scalars(finished), key=place)[:size]


def record_outcome(session: Session, task: JobTask, outcome: JobResult, now_us: int) -> SpotCheck:
    """Compare an outcome with the result of the submission, and write the comparison to the audit log."""
    checked = (JobRow.is_of(task.submission), JobRow.scenario == task.scenario, JobRow.seed == task.seed)
    job = session.scalars(select(JobRow).where(*checked)).one()
    check = _compare(job, outcome)
    entry = {"submission": check.submission, "job": job.id, "same": check.same, "text": check.text}
    audit.add_entry(session, "server", "spot-check", entry, now_us)
    if not check.same:
        LOG.error("spot check of job %d, submission %s: %s", job.id, check.submission, check.text)
    return check


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
        tasks = [task for submission in chosen for task in _make_tasks(session, submission, settings, suites)]
    with ProcessPool[JobTask, JobResult](function, max(1, min(settings.work.processes, len(tasks))), LIMIT_S) as pool:
        for task, outcome in pool.run(tasks):
            if (failure := describe_failure(outcome)) is not None:
                LOG.warning("spot check of job %d: %s", task.job, failure)
            else:
                assert not isinstance(outcome, WorkerFailure), "a failure on our side"
                with store.write() as session:
                    check = record_outcome(session, task, outcome, clock())
                yield check


def list_finished(session: Session, most: int) -> Sequence[str]:
    """Return the latest submissions that are done, for `run_spot_checks`."""
    done = (
        select(SubmissionRow.id)
        .where(SubmissionRow.state == SubmissionState.DONE)
        .order_by(SubmissionRow.finished_us.desc())
    )
    return session.scalars(done.limit(most)).all()


def _make_tasks(session: Session, submission: str, settings: ServerSettings, suites: PhaseSuites) -> Sequence[JobTask]:
    """Return the tasks of a submission's spot checks; none if it cannot be run or was run by another evaluator.

    Raises NotFound.
    """
    submissions.get(session, submission)
    tasks: list[JobTask] = []
    for job in sample_jobs(session, submission, audit.find_head(session)):
        try:
            task = load_task(session, job, settings, suites)
        except InputError as error:
            LOG.warning("submission %s: not checked: %s", submission, error)
            return ()
        if task is None:
            LOG.warning("submission %s: %s", submission, NOT_COMPARED)
        else:  # a stage folder of its own
            tasks.append(replace(task, kind=JobKind.SPOT_CHECK, attempt=-os.getpid()))
    return tasks


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
