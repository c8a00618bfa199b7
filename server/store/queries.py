"""What pages and clients ask: leaderboards, a team's history, the queue, progress, load."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from server.enums import JobState, State, Track
from server.store.errors import NotFound
from server.store.quota import UNFINISHED
from server.store.standings import OVERALL, Figures, slice_of
from server.store.tables import Job, Standing, Submission, Team

DECENTRALISED = (Track.SINGLE, Track.SHARING, Track.NEGOTIATION)
_RECENT_JOBS = 100


@dataclass(frozen=True, slots=True)
class Row:
    """One line of a leaderboard: the best shown submission of a team, or a published result."""

    rank: int | None
    """None where it is not comparable: another evaluator, or published."""
    team: str
    method: str
    track: str
    submission: str | None
    ds: float
    figures: Figures
    created_us: int | None
    published: bool = False


@dataclass(frozen=True, slots=True)
class Queue:
    """What is before a submission."""

    position: int
    """1: nothing else waits before it; 0: it is finished."""
    jobs_ahead: int
    """Jobs of older submissions and its own that are not finished."""
    job_us: int | None
    """Mean duration of the last jobs; None before the first."""


def leaderboard(
    session: Session, phase: str, track: Track | None, bucket: str | None = None, category: str | None = None
) -> list[Row]:
    """The best of each team by DS, ties to the earlier. Without a track: all in which every CAV decides for itself.

    Ranked are the results of the evaluator that finished one last; a team without one stands below, unranked.
    """
    tracks = DECENTRALISED if track is None else (track,)
    columns = (
        Standing.team,
        Standing.evaluator,
        Standing.created_us,
        Team.name,
        Standing.method,
        Standing.track,
        Standing.submission,
        Standing.ds,
        Standing.figures,
    )
    found = session.execute(
        select(*columns)
        .join(Team, Team.id == Standing.team)
        .where(
            Standing.phase == phase,
            Standing.slice == slice_of(bucket, category),
            Standing.track.in_([track.value for track in tracks]),
            ~Team.hidden,
        )
        .order_by(Standing.ds.desc(), Standing.created_us, Standing.submission)
    ).all()
    current = _last_to_finish(session, {row.submission: row.evaluator for row in found})
    rows: dict[str, Row] = {}
    for of_current in (True, False):
        for id_, evaluator, created_us, team, method, in_track, submission, ds, figures in found:
            if id_ not in rows and (evaluator == current) is of_current:
                rank = len(rows) + 1 if of_current else None
                rows[id_] = Row(rank, team, method, in_track, submission, ds, figures, created_us)
    return list(rows.values())


def _last_to_finish(session: Session, evaluators: dict[str, str]) -> str:
    """Of submissions and their evaluators. It reads nothing more where all have the same, as nearly always."""
    if len(set(evaluators.values())) < 2:
        return next(iter(evaluators.values()), "")
    last = select(Submission.id).where(Submission.id.in_(evaluators)).order_by(Submission.finished_us.desc())
    return evaluators[session.scalars(last.limit(1)).one()]


def standing(session: Session) -> frozenset[str]:
    """Submissions that stand on an overall leaderboard."""
    return frozenset(session.scalars(select(Standing.submission).where(Standing.slice == OVERALL)))


def history(session: Session, team: str, phase: str) -> Sequence[Submission]:
    """All submissions of a team in a phase, the oldest first."""
    mine = select(Submission).where(Submission.team == team, Submission.phase == phase)
    return session.scalars(mine.order_by(Submission.created_us, Submission.id)).all()


def courses(session: Session, phase: str, track: Track | None, of: Collection[str]) -> dict[str, list[float]]:
    """DS of some teams' (their ids) shown submissions over time: the sparklines of a leaderboard by one query."""
    tracks = DECENTRALISED if track is None else (track,)
    columns = (Submission.team, Submission.ds, Submission.state, Submission.shown, Submission.track)  # of the index
    mine = select(*columns).where(Submission.team.in_(of), Submission.phase == phase, Submission.ds.is_not(None))
    found: dict[str, list[float]] = {}
    for team, ds, state, shown, driven in session.execute(mine.order_by(Submission.created_us, Submission.id)):
        # Asked for here: SQLite would search by state first.
        if state == State.DONE and shown and ds is not None and driven in tracks:
            found.setdefault(team, []).append(ds)
    return found


def progress(session: Session, submission: str) -> dict[JobState, int]:
    """How many jobs are in which state."""
    counts = select(Job.state, func.count()).where(Job.submission == submission).group_by(Job.state)
    return {JobState(state): number for state, number in session.execute(counts)}


def queue_position(session: Session, submission_id: str) -> Queue:
    """By age, as it would be if every team had one submission; the fair share only ever helps. Raises NotFound."""
    submission = session.get(Submission, submission_id)
    if submission is None:
        raise NotFound(f"submission: there is no {submission_id!r}")
    if submission.state not in UNFINISHED:
        return Queue(0, 0, job_us(session))
    waiting = select(Submission.id).where(
        Submission.state.in_(UNFINISHED),
        (Submission.created_us < submission.created_us)
        | ((Submission.created_us == submission.created_us) & (Submission.id <= submission.id)),
    )
    undone = Job.state.in_((JobState.QUEUED.value, JobState.RUNNING.value))
    jobs = select(func.count()).select_from(Job).where(undone, Job.submission.in_(waiting))
    position = select(func.count()).select_from(waiting.subquery())
    return Queue(session.scalar(position) or 0, session.scalar(jobs) or 0, job_us(session))


def job_us(session: Session) -> int | None:
    """Mean duration of the last jobs finished; None before the first."""
    last = select(Job.finished_us - Job.started_us).where(Job.state == JobState.DONE)
    durations = session.scalars(last.order_by(Job.id.desc()).limit(_RECENT_JOBS)).all()
    return sum(durations) // len(durations) if durations else None


def load(session: Session) -> tuple[dict[State, int], dict[JobState, int]]:
    """Submissions and jobs by state, for the metrics."""
    submissions = session.execute(select(Submission.state, func.count()).group_by(Submission.state))
    jobs = session.execute(select(Job.state, func.count()).group_by(Job.state))
    return (
        {State(state): number for state, number in submissions},
        {JobState(state): number for state, number in jobs},
    )
