"""Worker time: what teams used of it recently, for the order of work, and what a submission may use in total."""

from collections.abc import Mapping

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from server.enums import JobKind, JobState
from server.store.tables import JobRow, SubmissionRow, WorkerTimeRow

HALF_LIFE_US = 24 * 3_600_000_000
"""Time after which used worker time counts half [us]. A team that always has work is then about 35 hours times its
share of the workers behind: a team with a submission a day comes before it for all of that submission, not only for its
first jobs, as with 6 hours (the simulated week of `tests/server/store/test_store_fairness.py`)."""

WorkerTimes = Mapping[tuple[str, str], int]
"""Recent worker time [us] by team and phase."""


def charge(session: Session, submission: SubmissionRow, used_us: int, now_us: int) -> None:
    """Add worker time to the team and phase of a submission."""
    key = (submission.team, submission.phase)
    row = session.get(WorkerTimeRow, key)
    if row is None:
        row = WorkerTimeRow(team=key[0], phase=key[1], used_us=0, at_us=now_us)
        session.add(row)
    row.used_us = decay(row.used_us, now_us - row.at_us) + max(0, used_us)
    row.at_us = now_us


def load_recent(session: Session, now_us: int) -> dict[tuple[str, str], int]:
    """Return the recent worker time by team and phase, that of running jobs included."""
    used_by_team = {
        (row.team, row.phase): decay(row.used_us, now_us - row.at_us) for row in session.scalars(select(WorkerTimeRow))
    }
    running = (
        select(SubmissionRow.team, SubmissionRow.phase, func.sum(now_us - JobRow.started_us))
        .join(SubmissionRow, SubmissionRow.id == JobRow.submission)
        .where(JobRow.kind == JobKind.SUBMISSION, JobRow.state == JobState.RUNNING)
        .group_by(SubmissionRow.team, SubmissionRow.phase)
    )
    for team, phase, used_us in session.execute(running):
        used_by_team[team, phase] = used_by_team.get((team, phase), 0) + max(0, int(used_us))
    return used_by_team


def decay(used_us: int, age_us: int) -> int:
    """Return what is left of worker time after `age_us`; a clock that jumps back changes nothing."""
    return int(used_us * 0.5 ** (max(0, age_us) / HALF_LIFE_US))


def charge_running(session: Session, submission: SubmissionRow, now_us: int) -> None:
    """Charge the jobs of a submission that are running and about to be cancelled."""
    charge(session, submission, _running_us(session, submission.id, now_us), now_us)


def spent_us(session: Session, submission: SubmissionRow, now_us: int) -> int:
    """Return the worker time that counts towards a submission's budget: finished jobs and running ones [us]."""
    return submission.spent_us + _running_us(session, submission.id, now_us)


def _running_us(session: Session, submission_id: str, now_us: int) -> int:
    running = select(func.sum(now_us - JobRow.started_us)).where(
        JobRow.is_of(submission_id), JobRow.state == JobState.RUNNING
    )
    return max(0, int(session.scalar(running) or 0))
