"""After an update: submissions that are not finished begin anew, so that no result mixes two evaluators."""

from sqlalchemy import select

from server.settings import Settings
from server.store import Store, phases, quota, submissions
from server.store.models import Submission
from server.suites import LoadedSuites, Suites


def renewed(store: Store, settings: Settings, now_us: int, suites: Suites | None = None) -> int:
    """Queues anew what another evaluator has begun or was to begin; returns how many submissions.

    Their jobs are those that the suite has now. Whoever still drives one of the old ones loses it with the next
    heartbeat. Only `serve` does this, at its start.
    """
    suites = suites or LoadedSuites(settings)
    count = 0
    with store.write() as session:
        for submission in session.scalars(select(Submission).where(Submission.state.in_(quota.UNFINISHED))).all():
            phase = phases.get(session, submission.phase)
            evaluator = suites.evaluator(phase, submission.environment)
            if submission.evaluator != evaluator:
                submissions.renew(session, submission, evaluator, suites.jobs(phase), now_us)
                count += 1
    return count
