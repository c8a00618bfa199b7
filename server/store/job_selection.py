"""Order of work: which submission gets the next job.

The team with the least recent worker time is next, whatever its phases; within a team, the phase with the least. Only
between equals do hidden phases come before public ones, and older submissions before younger ones.
"""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from sqlalchemy import exists, func, select
from sqlalchemy.orm import Session

from server.enums import JobState
from server.store import worker_time
from server.store.quota import UNFINISHED
from server.store.tables import JobRow, PhaseRow, SubmissionRow

STEP_US = 60_000_000
"""Worker times that differ by less count as equal [us]: teams then take turns job by job."""


class WaitingSubmission(NamedTuple):
    """An unfinished submission with queued jobs."""

    id: str
    team: str
    phase: str
    public: bool
    created_us: int


def select_next(session: Session, now_us: int, public: bool | None = None) -> str | None:
    """Return the id of the submission whose job is next; None if no job waits.

    public: only jobs of public phases, or only of hidden ones; None: of all.
    """
    waiting = _list_waiting(session, public)
    if len(waiting) < 2:
        return waiting[0].id if waiting else None
    return choose(waiting, worker_time.load_recent(session, now_us), _count_running(session))


def choose(waiting: Sequence[WaitingSubmission], recent: worker_time.WorkerTimes, running: Counter[str]) -> str:
    """Return the id of the next submission. running: number of running jobs by team."""
    of_team: Counter[str] = Counter()
    for (team, _), used_us in recent.items():
        of_team[team] += used_us

    def place(one: WaitingSubmission) -> tuple[int, int, int, bool, int, str]:
        in_phase = recent.get((one.team, one.phase), 0)
        team_us = of_team[one.team]
        return (team_us // STEP_US, running[one.team], in_phase // STEP_US, one.public, one.created_us, one.id)

    return min(waiting, key=place).id


def _list_waiting(session: Session, public: bool | None) -> list[WaitingSubmission]:
    queued = exists().where(JobRow.submission == SubmissionRow.id, JobRow.state == JobState.QUEUED)
    columns = (SubmissionRow.id, SubmissionRow.team, SubmissionRow.phase, PhaseRow.public, SubmissionRow.created_us)
    found = (
        select(*columns)
        .join(PhaseRow, PhaseRow.id == SubmissionRow.phase)
        .where(SubmissionRow.state.in_(UNFINISHED), queued, *([] if public is None else [PhaseRow.public == public]))
    )
    return [WaitingSubmission(*row) for row in session.execute(found)]


def _count_running(session: Session) -> Counter[str]:
    counts = (
        select(SubmissionRow.team, func.count())
        .join(JobRow, JobRow.submission == SubmissionRow.id)
        .where(JobRow.state == JobState.RUNNING)
        .group_by(SubmissionRow.team)
    )
    found: Counter[str] = Counter()
    for team, count in session.execute(counts):
        found[team] = count
    return found
