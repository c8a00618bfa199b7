"""A small challenge for the tests of the store. Times are in seconds here, and read as such in the tests."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from sqlalchemy import select
from sqlalchemy.orm import Session

from server.clock import DAY_US
from server.enums import ChallengeTrack, ScenarioVerdict
from server.store import Store, audit, jobs, phases, submissions, teams
from server.store.standings import SummaryData
from server.store.tables import JobRow, SubmissionRow

S = 1_000_000
LEASE = 60 * S
NOON = 20_000 * DAY_US + DAY_US // 2
"""Of some day; all tests happen around it."""
PHASE = phases.NewPhase("dev", "Development", "interdrive", True, 0, 30_000 * DAY_US, 3, 2, 100)
NEW = submissions.NewSubmission(
    "", ChallengeTrack.SINGLE, "method", "a" * 64, 1000, "python3.11-numpy", {"version": "1"}
)
JOBS = (("left-turn", 0), ("merge", 0))
GOOD = jobs.JobOutcome(ScenarioVerdict.OK, {"ds": 80.0, "sr": 100.0})


def with_teams(store: Store, *names: str, phase: phases.NewPhase = PHASE) -> list[str]:
    """Ids of new teams; the phase is there, too."""
    with store.write() as session:
        phases.set_phases(session, [phase], NOON)
        return [teams.create(session, name, NOON).id for name in names]


def sent(session: Session, team: str, now_us: int = NOON, **changed: Any) -> SubmissionRow:
    """A new submission of another archive than any before; `phase`, `jobs` and fields of NewSubmission can be given."""
    phase = phases.get(session, changed.pop("phase", PHASE.id))
    wanted = changed.pop("jobs", JOBS)
    sha256 = f"{now_us:x}".rjust(64, "0")
    return submissions.accept(
        session, replace(NEW, **({"team": team, "archive_sha256": sha256} | changed)), phase, wanted, now_us
    )


def driven(session: Session, submission: SubmissionRow, now_us: int, ds: float = 80.0, sensing: str = "object") -> None:
    """Runs a submission to its end; nothing else may be queued. sensing: its sensing track."""
    while (job := jobs.claim(session, "worker", LEASE, now_us)) is not None:
        assert job.submission == submission.id
        assert jobs.finish(session, job.id, "worker", job.attempt, GOOD, now_us + S)
    results = summary(ds, submissions.list_finished_jobs(session, submission.id)) | {"sensing_track": sensing}
    assert submissions.finish_if_complete(session, submission.id, results, now_us + S)


def summary(ds: float, finished: Sequence[JobRow] = ()) -> SummaryData:
    """The same in all parts, but for one bucket, in which it is the other way round. finished: the jobs of it."""
    return {
        "overall": {"ds": ds, "sr": 50.0},
        "buckets": {"interdrive": {"ds": ds}, "interaction": {"ds": 100.0 - ds}},
        "categories": {"merge": {"ds": ds}},
        "sensing_track": "object",
        "results_sha256": audit.compute_results_checksum(finished),
    }


def states(session: Session, submission: str) -> list[str]:
    """Of its jobs, in order."""
    return list(session.scalars(select(JobRow.state).where(JobRow.submission == submission).order_by(JobRow.id)))


def all_of(session: Session, model: Any) -> Sequence[Any]:
    """Every row."""
    return session.scalars(select(model)).all()
