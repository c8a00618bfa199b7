"""After an update: submissions that are not finished begin anew, so that no result mixes two evaluators."""

from sqlalchemy import select, update

from server.settings import Settings
from server.store import Store, audit, events, phases, quota
from server.store.models import Job, Submission
from server.suites import LoadedSuites, Suites
from server.words import JobState, State


def renewed(store: Store, settings: Settings, now_us: int, suites: Suites | None = None) -> int:
    """Queues anew what another evaluator has begun or was to begin; returns how many submissions.

    Whoever still drives one of them loses its job with the next heartbeat. Only `serve` does this, at its start.
    """
    suites = suites or LoadedSuites(settings)
    count = 0
    with store.write() as session:
        for submission in session.scalars(select(Submission).where(Submission.state.in_(quota.UNFINISHED))).all():
            evaluator = suites.evaluator(phases.get(session, submission.phase))
            if submission.evaluator == evaluator:
                continue
            again = {
                "state": JobState.QUEUED.value, "owner": None, "lease_us": None, "verdict": None, "reason": None,
                "result": None, "usage": None, "finished_us": None, "failures": 0, "failure": "",
            }  # fmt: skip
            session.execute(update(Job).where(Job.submission == submission.id).values(**again))
            submission.evaluator, submission.state = evaluator, State.QUEUED.value
            events.add(session, submission.id, "state", {"state": State.QUEUED.value}, now_us)
            audit.add(
                session, "server", "submission-renewed", {"submission": submission.id, "evaluator": evaluator}, now_us
            )
            count += 1
    return count
