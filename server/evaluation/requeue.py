"""Restarts unfinished submissions after an update, so that no result mixes two evaluators."""

import logging

from sqlalchemy import select

from mdrive_sumo.core.errors import InputError
from server.phase_suites import LoadedPhaseSuites, PhaseSuites
from server.settings import ServerSettings
from server.store import Store, phases, quota, submissions
from server.store.tables import SubmissionRow

LOG = logging.getLogger("mdrive.supervisor")


def requeue_outdated(store: Store, settings: ServerSettings, now_us: int, suites: PhaseSuites | None = None) -> int:
    """Restart unfinished submissions of another evaluator with the present jobs of their suites; return how many.

    A worker that still runs an old job loses it with its next heartbeat. Submissions that can no longer be run fail on
    our side. Only `serve` calls this, at its start.
    """
    suites = suites or LoadedPhaseSuites(settings)
    count = 0
    with store.write() as session:
        for submission in session.scalars(select(SubmissionRow).where(SubmissionRow.state.in_(quota.UNFINISHED))).all():
            phase = phases.get(session, submission.phase)
            try:
                evaluator, jobs = suites.evaluator(phase, submission.environment), suites.jobs(phase)
            except InputError as error:  # the suite of a closed phase: for open phases the server has refused to start
                LOG.error("submission %s can no longer be run: %s", submission.id, error)
                submissions.fail(session, submission.id, "the suite of its phase can no longer be run", now_us)
                continue
            if submission.evaluator != evaluator:
                submissions.renew(session, submission, evaluator, jobs, now_us)
                count += 1
    return count
