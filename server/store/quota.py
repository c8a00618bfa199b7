"""Quota of a team in a phase: submissions per UTC day, at a time, in total."""

from dataclasses import dataclass

from sqlalchemy import func, select
from sqlalchemy.orm import Session

from server.clock import DAY_US, day_start_us, format_utc
from server.enums import JobState, SubmissionState
from server.errors import OverLimit
from server.store.tables import JobRow, PhaseRow, RefusedUploadRow, SubmissionRow

UNFINISHED = (SubmissionState.QUEUED.value, SubmissionState.RUNNING.value)
_RETRY_US = 60_000_000
"""Time after which a team may try again that has too many submissions at a time [us]; when one ends is unknown."""


@dataclass(frozen=True, slots=True)
class QuotaUsage:
    """What a team has used of a phase's quota."""

    today: int
    """Submissions of this UTC day, cancelled ones included."""
    in_parallel: int
    """Unfinished submissions."""
    in_total: int
    """Submissions that count, of all days."""


def count_used(session: Session, team: str, phase: str, now_us: int) -> QuotaUsage:
    """Count the submissions that count; failures on our side and re-runs by an admin do not.

    Cancelled ones count against the day: each stores an archive, so submitting and cancelling must be limited.
    """
    day = day_start_us(now_us)
    counts = (
        func.count().filter(SubmissionRow.created_us >= day),
        func.count().filter(SubmissionRow.state.in_(UNFINISHED)),
        func.count().filter(SubmissionRow.counts),
    )
    cancelled = SubmissionRow.state == SubmissionState.CANCELLED
    mine = (SubmissionRow.team == team, SubmissionRow.phase == phase, SubmissionRow.counts | cancelled)
    return QuotaUsage(*session.execute(select(*counts).where(*mine)).one())


def check_quota(session: Session, team: str, phase: PhaseRow, now_us: int) -> None:
    """Raise OverLimit if a quota is used up. Only the inserting transaction can rely on it."""
    now = count_used(session, team, phase.id, now_us)
    if now.in_total >= phase.in_total:
        raise OverLimit("total", f"phase {phase.id}: all {phase.in_total} submissions are used", None)
    if now.today >= phase.per_day:
        tomorrow = day_start_us(now_us) + DAY_US
        retry = format_utc(tomorrow)
        sentence = (
            f"phase {phase.id}: the {phase.per_day} submissions of today are used; the next one is possible at {retry}"
        )
        raise OverLimit("day", sentence, tomorrow)
    if now.in_parallel >= phase.in_parallel:
        sentence = (
            f"phase {phase.id}: {now.in_parallel} of at most {phase.in_parallel} submissions at a time are unfinished"
        )
        raise OverLimit("parallel", sentence, now_us + _RETRY_US)


def count_refused(session: Session, team: str, now_us: int) -> int:
    """Count the archives of a team that were examined and refused on this UTC day."""
    refused = (RefusedUploadRow.team == team, RefusedUploadRow.at_us >= day_start_us(now_us))
    return session.scalar(select(func.count()).select_from(RefusedUploadRow).where(*refused)) or 0


def check_refused(session: Session, team: str, per_day: int, now_us: int) -> None:
    """Raise OverLimit if too many archives of a team were refused today: each costs the time of a checker."""
    if count_refused(session, team, now_us) >= per_day:
        tomorrow = day_start_us(now_us) + DAY_US
        sentence = (
            f"archive: {per_day} archives of your team were refused today; the next one is possible at "
            f"{format_utc(tomorrow)}; test archives with `mdrive-sumo check`"
        )
        raise OverLimit("refused", sentence, tomorrow)


def add_refused(session: Session, team: str, now_us: int) -> None:
    """Count an archive that was refused."""
    session.add(RefusedUploadRow(team=team, at_us=now_us))


def count_rejected(session: Session, submission: SubmissionRow, now_us: int) -> None:
    """Count a submission that is rejected before its first result as a refused upload, not against the quota.

    Its agent's sensors could not be checked at upload. In a hidden phase it counts: every start may disclose something.
    """
    done = select(func.count()).where(JobRow.is_of(submission.id), JobRow.state == JobState.DONE)
    phase = session.get(PhaseRow, submission.phase)
    if submission.counts and phase is not None and phase.public and not session.scalar(done):
        add_refused(session, submission.team, now_us)
        submission.counts = False
