"""Cross-play jobs: for every pair of ranked agents a few scenarios with one CAV of the first among CAVs of the second.

They are claimed, kept and finished as `server.store.jobs` does it, but only while no job of a submission waits.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sqlalchemy import ColumnElement, and_, exists, func, select, update
from sqlalchemy.orm import Session, aliased

from server.enums import JobState, SubmissionState
from server.store import audit, queries, standings
from server.store.jobs import MAX_FAILURES
from server.store.queries import LeaderboardEntry
from server.store.tables import CrossPlayJobRow, JobOverviewRow, JobRow, PhaseRow, SubmissionRow

MAX_AGENTS = 20
"""Agents of a board, the best by DS: with 3 scenarios for each pair they make 1140 jobs."""
SEED = 0
"""Scenarios are driven as they are written; the seed also draws which CAV is under test."""


@dataclass(frozen=True, slots=True)
class CrossPlayScore:
    """What one job found, for the CAV under test. DS and SR in percent."""

    ds: float
    sr: float
    tested_failed: str
    """Why the agent under test failed; "" if it did not. It keeps its score."""
    others_failed: str
    """Why an agent of the others failed; "" if none did."""
    by_messages: bool = False
    """Whether messages of the agent under test made it fail: then the job counts. Otherwise it says nothing about the
    agent under test."""

    @property
    def counts(self) -> bool:
        """Whether the job says something about the agent under test."""
        return not self.others_failed or self.by_messages


def list_agents(session: Session, phase: str) -> list[LeaderboardEntry]:
    """Return the ranked entries of a phase, the best `MAX_AGENTS` by DS: each team's best of each sensing track."""
    ranked = [entry for entry in queries.find_leaderboard(session, phase, None) if entry.rank is not None]
    return sorted(ranked, key=lambda entry: -entry.ds)[:MAX_AGENTS]


def list_missing(
    session: Session, phase: PhaseRow, agents: Sequence[LeaderboardEntry], evaluator: str
) -> list[tuple[str, str, str]]:
    """Return the jobs (tested, others, scenario) that these agents have not under this evaluator, in their order.

    Agents of one team are no strangers and make no pair. All pairs get their first scenario before any gets its second.
    """
    known = session.execute(
        select(CrossPlayJobRow.tested, CrossPlayJobRow.others, CrossPlayJobRow.scenario).where(
            CrossPlayJobRow.phase == phase.id, CrossPlayJobRow.evaluator == evaluator
        )
    )
    present = {tuple(row) for row in known}
    pairs = [(str(a.submission), str(b.submission)) for a in agents for b in agents if a.team != b.team]
    if not pairs:
        return []
    scenarios = _choose_scenarios(session, phase, pairs[0][0])
    return [(*pair, scenario) for scenario in scenarios for pair in pairs if (*pair, scenario) not in present]


def plan(session: Session, phase: PhaseRow, agents: Sequence[LeaderboardEntry], evaluator: str) -> int:
    """Add the jobs of `list_missing`; return how many."""
    missing = list_missing(session, phase, agents, evaluator)
    session.add_all(
        CrossPlayJobRow(
            phase=phase.id,
            evaluator=evaluator,
            tested=tested,
            others=others,
            scenario=scenario,
            state=JobState.QUEUED.value,
        )
        for tested, others, scenario in missing
    )
    session.flush()
    return len(missing)


def _choose_scenarios(session: Session, phase: PhaseRow, submission: str) -> list[str]:
    """Return the scenarios of a phase's pairs: drawn by name from those with two CAVs or more in a finished result."""
    results = select(JobRow.scenario, JobOverviewRow.data).join(JobOverviewRow, JobOverviewRow.job == JobRow.id)
    driven = session.execute(results.where(JobRow.submission == submission, JobRow.seed == SEED)).all()
    shared = [scenario for scenario, data in driven if len(data.get("egos") or ()) > 1]
    drawn = sorted(shared, key=lambda name: hashlib.sha256(f"{phase.id}/{name}".encode()).digest())
    return drawn[: phase.cross_play_scenarios]


def claim(session: Session, owner: str, lease_us: int, now_us: int) -> CrossPlayJobRow | None:
    """Claim the next job of a pair whose submissions are still shown; return None if there is none.

    Jobs with expired leases are put back first.
    """
    lapsed = and_(CrossPlayJobRow.state == JobState.RUNNING, CrossPlayJobRow.lease_us < now_us)
    for job in session.scalars(select(CrossPlayJobRow).where(lapsed)).all():
        _apply_failure(job, f"lease of {job.owner} ended in attempt {job.attempt}", now_us)
    session.flush()
    job = session.scalar(_select_waiting().limit(1))
    if job is None:
        return None
    job.state, job.owner, job.lease_us = JobState.RUNNING.value, owner, now_us + lease_us
    job.attempt += 1
    session.flush()
    return job


def is_any_waiting(session: Session, now_us: int) -> bool:
    """Return whether a claim is worth a write transaction."""
    lapsed = select(exists().where(CrossPlayJobRow.state == JobState.RUNNING, CrossPlayJobRow.lease_us < now_us))
    return session.scalar(_select_waiting().limit(1)) is not None or bool(session.scalar(lapsed))


def _select_waiting() -> Any:
    """Return the query of the jobs that may be claimed; the pair with the fewest begun jobs is next: all take turns."""
    tested, others, same = aliased(SubmissionRow), aliased(SubmissionRow), aliased(CrossPlayJobRow)
    begun = (
        select(func.count())
        .where(same.tested == CrossPlayJobRow.tested, same.others == CrossPlayJobRow.others, same.attempt > 0)
        .scalar_subquery()
    )
    return (
        select(CrossPlayJobRow)
        .join(PhaseRow, PhaseRow.id == CrossPlayJobRow.phase)
        .join(tested, tested.id == CrossPlayJobRow.tested)
        .join(others, others.id == CrossPlayJobRow.others)
        .where(
            CrossPlayJobRow.state == JobState.QUEUED,
            PhaseRow.cross_play_scenarios > 0,
            *(one.state == SubmissionState.DONE for one in (tested, others)),
            *(one.shown for one in (tested, others)),
        )
        .order_by(CrossPlayJobRow.failures, begun, CrossPlayJobRow.id)
    )


def heartbeat(session: Session, job_id: int, owner: str, attempt: int, lease_us: int, now_us: int) -> bool:
    """Prolong the lease; return False if the job is another's."""
    held = update(CrossPlayJobRow).where(_is_held_by(job_id, owner, attempt)).values(lease_us=now_us + lease_us)
    return len(session.scalars(held.returning(CrossPlayJobRow.id)).all()) == 1


def finish(session: Session, job_id: int, owner: str, attempt: int, score: CrossPlayScore, now_us: int) -> bool:
    """Store the score of a job; return False if the job is another's."""
    job = session.scalar(select(CrossPlayJobRow).where(_is_held_by(job_id, owner, attempt)))
    if job is None:
        return False
    found = {name: getattr(score, name) for name in CrossPlayScore.__slots__}
    job.state, job.result, job.finished_us, job.lease_us = JobState.DONE.value, found, now_us, None
    pair = {"phase": job.phase, "tested": job.tested, "others": job.others, "scenario": job.scenario}
    audit.add_entry(session, "server", "cross-play-done", pair | found, now_us)
    return True


def record_failure(session: Session, job_id: int, owner: str, attempt: int, failure: str, now_us: int) -> None:
    """Record a failure on our side: the job is queued again, or left out of the board with its third failure."""
    job = session.scalar(select(CrossPlayJobRow).where(_is_held_by(job_id, owner, attempt)))
    if job is not None:
        _apply_failure(job, failure, now_us)


def reject(session: Session, job_id: int, owner: str, attempt: int, why: str, now_us: int) -> None:
    """End a job that has no score, because one of its agents asked for what is not allowed."""
    job = session.scalar(select(CrossPlayJobRow).where(_is_held_by(job_id, owner, attempt)))
    if job is not None:
        job.failures = MAX_FAILURES - 1
        _apply_failure(job, why, now_us)


def release(session: Session, job_id: int, owner: str, attempt: int) -> None:
    """Put the job back without counting a failure, for a graceful shutdown."""
    held = update(CrossPlayJobRow).where(_is_held_by(job_id, owner, attempt))
    session.execute(held.values(state=JobState.QUEUED.value, owner=None, lease_us=None))


def cancel(session: Session, job_id: int, now_us: int) -> None:
    """End a job of another evaluator; `plan` adds it anew under the present one."""
    values = {"state": JobState.CANCELLED.value, "finished_us": now_us, "owner": None, "lease_us": None}
    session.execute(update(CrossPlayJobRow).where(CrossPlayJobRow.id == job_id).values(**values))


def list_jobs(session: Session, phase: str, agents: Sequence[LeaderboardEntry]) -> Sequence[CrossPlayJobRow]:
    """Return the jobs among these agents under the evaluator that ranks them."""
    ids = [entry.submission for entry in agents]
    if not ids:
        return ()
    first = session.get(SubmissionRow, ids[0])
    assert first is not None, "a foreign key"
    of_board = (
        CrossPlayJobRow.phase == phase,
        CrossPlayJobRow.evaluator == standings.evaluator_digest(first.evaluator),
        CrossPlayJobRow.tested.in_(ids),
        CrossPlayJobRow.others.in_(ids),
        CrossPlayJobRow.state != JobState.CANCELLED,
    )
    return session.scalars(select(CrossPlayJobRow).where(*of_board).order_by(CrossPlayJobRow.id)).all()


def _apply_failure(job: CrossPlayJobRow, failure: str, now_us: int) -> None:
    job.failures += 1
    job.failure, job.owner, job.lease_us = failure, None, None
    is_last = job.failures >= MAX_FAILURES
    job.state = JobState.FAILED.value if is_last else JobState.QUEUED.value
    job.finished_us = now_us if is_last else None


def _is_held_by(job_id: int, owner: str, attempt: int) -> ColumnElement[bool]:
    row = CrossPlayJobRow
    return and_(row.id == job_id, row.owner == owner, row.attempt == attempt, row.state == JobState.RUNNING)
