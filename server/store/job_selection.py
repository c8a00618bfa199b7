"""Order of work: which job is next.

Spot checks come first, because a queue that is never empty must not delay them for ever; cross-play comes last, only
while nothing else waits. Of submissions the team with the least recent worker time is next, whatever its phases; within
a team, the phase with the least. Only between equals do hidden phases come before public ones, and older submissions
before younger ones.
"""

from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

from sqlalchemy import ColumnElement, Select, and_, exists, func, select
from sqlalchemy.orm import Session, aliased

from server.enums import JobKind, JobState, SubmissionState
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


def select_next(session: Session, now_us: int, public: bool | None = None) -> int | None:
    """Return the id of the next job; None if no job waits.

    public: only jobs of public phases, or only of hidden ones; None: of all.
    """
    of_phases = [] if public is None else [PhaseRow.public == public]
    check = session.scalar(_select_queued(JobKind.SPOT_CHECK).where(*of_phases).limit(1))
    if check is not None:
        return check
    waiting = _list_waiting(session, of_phases)
    if waiting:
        submission = waiting[0].id
        if len(waiting) > 1:
            submission = choose(waiting, worker_time.load_recent(session, now_us), _count_running(session))
        own = _select_queued(JobKind.SUBMISSION).where(JobRow.submission == submission)
        return session.scalar(own.limit(1))
    if session.scalar(select(exists().where(is_preferred()))):  # of the other phases
        return None
    return session.scalar(_select_pairs().where(*of_phases).limit(1))


def is_preferred() -> ColumnElement[bool]:
    """Return the condition on `JobRow` under which a job waits that comes before all cross-play."""
    return and_(JobRow.state == JobState.QUEUED, JobRow.kind != JobKind.CROSS_PLAY)


def is_pair_waiting(session: Session) -> bool:
    """Return whether a job of cross-play may be claimed once nothing else waits."""
    return session.scalar(_select_pairs().limit(1)) is not None


def _select_queued(kind: JobKind) -> Select[int]:
    return (
        select(JobRow.id)
        .join(SubmissionRow, SubmissionRow.id == JobRow.submission)
        .join(PhaseRow, PhaseRow.id == SubmissionRow.phase)
        .where(JobRow.state == JobState.QUEUED, JobRow.kind == kind)
        .order_by(JobRow.id)
    )


def _select_pairs() -> Select[int]:
    """Return the query of the jobs of cross-play whose submissions are still shown.

    The pair with the fewest begun jobs is next, so that all take turns.
    """
    others, same = aliased(SubmissionRow), aliased(JobRow)
    is_same = (same.kind == JobKind.CROSS_PLAY, same.submission == JobRow.submission, same.others == JobRow.others)
    begun = select(func.count()).where(*is_same, same.attempt > 0).scalar_subquery()
    return (
        _select_queued(JobKind.CROSS_PLAY)
        .join(others, others.id == JobRow.others)
        .where(
            PhaseRow.cross_play_scenarios > 0,
            *(each.state == SubmissionState.DONE for each in (SubmissionRow, others)),
            *(each.shown for each in (SubmissionRow, others)),
        )
        .order_by(None)
        .order_by(JobRow.failures, begun, JobRow.id)
    )


def choose(waiting: Sequence[WaitingSubmission], recent: worker_time.WorkerTimes, running: Counter[str]) -> str:
    """Return the id of the next submission. running: number of running jobs by team."""
    of_team: Counter[str] = Counter()
    for (team, _), used_us in recent.items():
        of_team[team] += used_us

    def place(each: WaitingSubmission) -> tuple[int, int, int, bool, int, str]:
        in_phase = recent.get((each.team, each.phase), 0)
        team_us = of_team[each.team]
        return (
            team_us // STEP_US,
            running[each.team],
            in_phase // STEP_US,
            each.public,
            each.created_us,
            each.id,
        )

    return min(waiting, key=place).id


def _list_waiting(session: Session, of_phases: Sequence[ColumnElement[bool]]) -> list[WaitingSubmission]:
    queued = exists().where(JobRow.is_of(SubmissionRow.id), JobRow.state == JobState.QUEUED)
    columns = (SubmissionRow.id, SubmissionRow.team, SubmissionRow.phase, PhaseRow.public, SubmissionRow.created_us)
    waiting = select(*columns).join(PhaseRow, PhaseRow.id == SubmissionRow.phase)
    waiting = waiting.where(SubmissionRow.state.in_(UNFINISHED), queued, *of_phases)
    return [WaitingSubmission(*row) for row in session.execute(waiting)]


def _count_running(session: Session) -> Counter[str]:
    """Return the number of running jobs by team; those of cross-play and spot checks are the organiser's."""
    counts = (
        select(SubmissionRow.team, func.count())
        .join(JobRow, JobRow.submission == SubmissionRow.id)
        .where(JobRow.state == JobState.RUNNING, JobRow.kind == JobKind.SUBMISSION)
        .group_by(SubmissionRow.team)
    )
    return Counter({row[0]: row[1] for row in session.execute(counts)})
