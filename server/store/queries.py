"""Queries of pages and clients: leaderboards, a team's history, the queue, progress, load."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass

from sqlalchemy import func, select, true
from sqlalchemy.orm import Session

from mdrive_sumo.contract import SensingTrack
from server.enums import ChallengeTrack, JobKind, JobState, SubmissionState
from server.errors import NotFound
from server.store.quota import UNFINISHED
from server.store.standings import OVERALL, FiguresData, slice_key
from server.store.tables import JobRow, StandingRow, SubmissionRow, TeamRow

DECENTRALISED = (ChallengeTrack.SINGLE, ChallengeTrack.SHARING, ChallengeTrack.NEGOTIATION)
_RECENT_JOBS = 100
"""Jobs whose mean duration estimates the time to a result; chosen: about half of a suite of 225 scenarios."""


@dataclass(frozen=True, slots=True)
class LeaderboardEntry:
    """One entry of a leaderboard: the best shown submission of a team, or a published result."""

    rank: int | None
    """None if it is not comparable: another evaluator, or published."""
    team: str
    method: str
    track: str
    sensing_track: str | None
    """sensor or object; None for published results."""
    submission: str | None
    ds: float
    figures: FiguresData
    created_us: int | None
    published: bool = False


@dataclass(frozen=True, slots=True)
class QueuePosition:
    """Position of a submission in the queue."""

    position: int
    """How many unfinished submissions are not younger, itself included; 0 if it is finished."""
    jobs_ahead: int
    """Unfinished jobs of older submissions and of its own."""
    job_us: int | None
    """Mean duration of the last jobs [us]; None before the first."""


_STANDING_COLUMNS = (
    StandingRow.team,
    StandingRow.evaluator,
    StandingRow.created_us,
    TeamRow.name,
    StandingRow.method,
    StandingRow.track,
    StandingRow.sensing_track,
    StandingRow.submission,
    StandingRow.ds,
    StandingRow.figures,
)


def find_leaderboard(
    session: Session,
    phase: str,
    track: ChallengeTrack | None,
    bucket: str | None = None,
    category: str | None = None,
    sensing_track: SensingTrack | None = None,
) -> list[LeaderboardEntry]:
    """Return the best entry of each team by DS, ties to the earlier; without a track, of all tracks but joint.

    The sensing tracks are ranked apart; without one, the entries of the object track come first. Results of the
    evaluator that finished one last are ranked; a team without one follows below, unranked.
    """
    tracks = DECENTRALISED if track is None else (track,)
    rows = session.execute(
        select(*_STANDING_COLUMNS)
        .join(TeamRow, TeamRow.id == StandingRow.team)
        .where(
            StandingRow.phase == phase,
            StandingRow.slice == slice_key(bucket, category),
            StandingRow.track.in_([track.value for track in tracks]),
            true() if sensing_track is None else StandingRow.sensing_track == sensing_track.value,
            ~TeamRow.hidden,
        )
        .order_by(StandingRow.ds.desc(), StandingRow.created_us, StandingRow.submission)
    ).all()
    current = _find_current_evaluator(session, {row.submission: row.evaluator for row in rows})
    places: dict[tuple[str, str], LeaderboardEntry] = {}
    ranks = {sensing.value: 0 for sensing in SensingTrack}
    for is_current in (True, False):
        for id_, evaluator, created_us, team, method, in_track, sensing, submission, ds, figures in rows:
            if (id_, sensing) in places or (evaluator == current) is not is_current:
                continue
            ranks[sensing] += 1
            rank = ranks[sensing] if is_current else None
            entry = LeaderboardEntry(rank, team, method, in_track, sensing, submission, ds, figures, created_us)
            places[id_, sensing] = entry
    return sorted(places.values(), key=lambda entry: entry.sensing_track != SensingTrack.OBJECT)


def _find_current_evaluator(session: Session, evaluators: dict[str, str]) -> str:
    """Return the evaluator of the submission that finished last; `evaluators` is by submission.

    Needs no query if all are the same, as nearly always.
    """
    if len(set(evaluators.values())) < 2:
        return next(iter(evaluators.values()), "")
    last = select(SubmissionRow.id).where(SubmissionRow.id.in_(evaluators)).order_by(SubmissionRow.finished_us.desc())
    return evaluators[session.scalars(last.limit(1)).one()]


def find_standing_ids(session: Session) -> frozenset[str]:
    """Return the ids of the submissions on overall leaderboards."""
    return frozenset(session.scalars(select(StandingRow.submission).where(StandingRow.slice == OVERALL)))


def list_history(session: Session, team: str, phase: str) -> Sequence[SubmissionRow]:
    """Return all submissions of a team in a phase, the oldest first."""
    mine = select(SubmissionRow).where(SubmissionRow.team == team, SubmissionRow.phase == phase)
    return session.scalars(mine.order_by(SubmissionRow.created_us, SubmissionRow.id)).all()


def find_score_histories(
    session: Session, phase: str, track: ChallengeTrack | None, team_ids: Collection[str]
) -> dict[str, list[float]]:
    """Return the DS of the shown submissions over time by team id, for a leaderboard's sparklines, with one query."""
    tracks = DECENTRALISED if track is None else (track,)
    columns = (
        SubmissionRow.team,
        SubmissionRow.ds,
        SubmissionRow.state,
        SubmissionRow.shown,
        SubmissionRow.track,
    )  # of the index
    mine = select(*columns).where(
        SubmissionRow.team.in_(team_ids), SubmissionRow.phase == phase, SubmissionRow.ds.is_not(None)
    )
    scores_by_team: dict[str, list[float]] = {}
    for team, ds, state, shown, driven in session.execute(mine.order_by(SubmissionRow.created_us, SubmissionRow.id)):
        # Filtered here: with a condition on the state SQLite would choose the index by state.
        if state == SubmissionState.DONE and shown and ds is not None and driven in tracks:
            scores_by_team.setdefault(team, []).append(ds)
    return scores_by_team


def count_jobs(session: Session, submission: str) -> dict[JobState, int]:
    """Return the number of a submission's jobs by state."""
    counts = select(JobRow.state, func.count()).where(JobRow.is_of(submission)).group_by(JobRow.state)
    return {JobState(state): number for state, number in session.execute(counts)}


def find_queue_position(session: Session, submission_id: str) -> QueuePosition:
    """Return the position by age, an upper bound: the fair order of teams can only improve it. Raises NotFound."""
    submission = session.get(SubmissionRow, submission_id)
    if submission is None:
        raise NotFound(f"submission: there is no {submission_id!r}")
    if submission.state not in UNFINISHED:
        return QueuePosition(0, 0, mean_job_us(session))
    waiting = select(SubmissionRow.id).where(
        SubmissionRow.state.in_(UNFINISHED),
        (SubmissionRow.created_us < submission.created_us)
        | ((SubmissionRow.created_us == submission.created_us) & (SubmissionRow.id <= submission.id)),
    )
    undone = (JobRow.kind == JobKind.SUBMISSION, JobRow.state.in_((JobState.QUEUED.value, JobState.RUNNING.value)))
    jobs = select(func.count()).select_from(JobRow).where(*undone, JobRow.submission.in_(waiting))
    position = select(func.count()).select_from(waiting.subquery())
    return QueuePosition(session.scalar(position) or 0, session.scalar(jobs) or 0, mean_job_us(session))


def mean_job_us(session: Session) -> int | None:
    """Return the mean duration of the last finished jobs of submissions [us]; None before the first."""
    done = (JobRow.kind == JobKind.SUBMISSION, JobRow.state == JobState.DONE)
    last = select(JobRow.finished_us - JobRow.started_us).where(*done)
    durations = session.scalars(last.order_by(JobRow.id.desc()).limit(_RECENT_JOBS)).all()
    return sum(durations) // len(durations) if durations else None


def count_by_state(session: Session) -> tuple[dict[SubmissionState, int], dict[JobState, int]]:
    """Return the numbers of submissions and of their jobs by state."""
    submissions = session.execute(select(SubmissionRow.state, func.count()).group_by(SubmissionRow.state))
    of_submissions = select(JobRow.state, func.count()).where(JobRow.kind == JobKind.SUBMISSION)
    jobs = session.execute(of_submissions.group_by(JobRow.state))
    return (
        {SubmissionState(state): number for state, number in submissions},
        {JobState(state): number for state, number in jobs},
    )
