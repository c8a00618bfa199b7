"""Cross-play: for every pair of ranked agents a few scenarios with one CAV of the first among CAVs of the second."""

import hashlib
from collections.abc import Sequence
from dataclasses import asdict, dataclass

from sqlalchemy import ColumnElement, select
from sqlalchemy.orm import Session

from server.enums import JobKind, JobState
from server.store import audit, jobs, queries, standings, submissions
from server.store.queries import LeaderboardEntry
from server.store.tables import JobOverviewRow, JobRow, PhaseRow

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
    pairs = [(str(a.submission), str(b.submission)) for a in agents for b in agents if a.team != b.team]
    if not pairs:
        return []
    of_board = (*_among(agents, evaluator), JobRow.state != JobState.CANCELLED)
    planned = select(JobRow.submission, JobRow.others, JobRow.scenario).where(*of_board)
    present = {tuple(row) for row in session.execute(planned)}
    scenarios = _choose_scenarios(session, phase, pairs[0][0])
    return [(*pair, scenario) for scenario in scenarios for pair in pairs if (*pair, scenario) not in present]


def plan(session: Session, phase: PhaseRow, agents: Sequence[LeaderboardEntry], evaluator: str) -> int:
    """Add the jobs of `list_missing`, or queue them again if they were cancelled; return how many."""
    missing = list_missing(session, phase, agents, evaluator)
    cancelled = select(JobRow).where(*_among(agents, evaluator), JobRow.state == JobState.CANCELLED)
    again = {(job.submission, job.others, job.scenario): job for job in session.scalars(cancelled)}
    for job in (again[key] for key in missing if key in again):
        job.state, job.finished_us = JobState.QUEUED.value, None
    session.add_all(
        JobRow(
            kind=JobKind.CROSS_PLAY.value,
            submission=tested,
            others=others,
            evaluator=evaluator,
            scenario=scenario,
            seed=SEED,
            state=JobState.QUEUED.value,
        )
        for tested, others, scenario in missing
        if (tested, others, scenario) not in again
    )
    session.flush()
    return len(missing)


def _choose_scenarios(session: Session, phase: PhaseRow, submission: str) -> list[str]:
    """Return the scenarios of a phase's pairs: drawn by name from those with two CAVs or more in a finished result."""
    results = select(JobRow.scenario, JobOverviewRow.data).join(JobOverviewRow, JobOverviewRow.job == JobRow.id)
    driven = session.execute(results.where(JobRow.is_of(submission), JobRow.seed == SEED)).all()
    shared = [scenario for scenario, data in driven if len(data.get("egos") or ()) > 1]
    drawn = sorted(shared, key=lambda name: hashlib.sha256(f"{phase.id}/{name}".encode()).digest())
    return drawn[: phase.cross_play_scenarios]


def finish(session: Session, job_id: int, owner: str, attempt: int, score: CrossPlayScore, now_us: int) -> bool:
    """Store the score of a job; return False if it is dropped."""
    result = asdict(score)
    job = jobs.end(session, job_id, owner, attempt, result, now_us)
    if job is None:
        return False
    phase = submissions.get(session, job.submission).phase
    pair = {"phase": phase, "tested": job.submission, "others": job.others, "scenario": job.scenario}
    audit.add_entry(session, "server", "cross-play-done", pair | result, now_us)
    return True


def list_jobs(session: Session, agents: Sequence[LeaderboardEntry]) -> Sequence[JobRow]:
    """Return the jobs among these agents of one phase under the evaluator that ranks them."""
    if not agents:
        return ()
    evaluator = standings.evaluator_digest(submissions.get(session, str(agents[0].submission)).evaluator)
    of_board = (*_among(agents, evaluator), JobRow.state != JobState.CANCELLED)
    return session.scalars(select(JobRow).where(*of_board).order_by(JobRow.id)).all()


def _among(agents: Sequence[LeaderboardEntry], evaluator: str) -> tuple[ColumnElement[bool], ...]:
    """Return the conditions of the jobs in which these agents drive among each other under an evaluator."""
    ids = [entry.submission for entry in agents]
    is_among = JobRow.submission.in_(ids), JobRow.others.in_(ids)
    return JobRow.kind == JobKind.CROSS_PLAY, JobRow.evaluator == evaluator, *is_among
