"""After an update: submissions that are not finished begin anew, so that no result mixes two evaluators."""

import logging

from sqlalchemy import select

from mdrive_sumo.core.errors import InputError
from server.phase_suites import LoadedPhaseSuites, PhaseSuites
from server.settings import ServerSettings
from server.store import Store, phases, quota, submissions
from server.store.tables import SubmissionRow

LOG = logging.getLogger("mdrive.supervisor")


def requeue_outdated(store: Store, settings: ServerSettings, now_us: int, suites: PhaseSuites | None = None) -> int:
    """Queues anew what another evaluator has begun or was to begin; returns how many submissions.

    Their jobs are those that the suite has now. Whoever still drives one of the old ones loses it with the next
    heartbeat. What cannot be driven any more is a failure of ours. Only `serve` does this, at its start.
    """
    suites = suites or LoadedPhaseSuites(settings)
    count = 0
    with store.write() as session:
        for submission in session.scalars(select(SubmissionRow).where(SubmissionRow.state.in_(quota.UNFINISHED))).all():
            phase = phases.get(session, submission.phase)
            try:
                evaluator, jobs = suites.evaluator(phase, submission.environment), suites.jobs(phase)
            except InputError as error:  # of a phase that is over: the server does not start without the others
                LOG.error("submission %s cannot be driven any more: %s", submission.id, error)
                submissions.fail(session, submission.id, "the suite of its phase cannot be driven any more", now_us)
                continue
            if submission.evaluator != evaluator:
                submissions.renew(session, submission, evaluator, jobs, now_us)
                count += 1
    return count
