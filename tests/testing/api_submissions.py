"""Submissions of the test server driven to their end, without a worker. No tests in here."""

from server.store import jobs, submissions
from testing.api_app import Server
from testing.store_samples import GOOD, LEASE, S, summary


def drive_submissions(server: Server, *ids: str, ds: float = 80.0) -> None:
    """Runs all that is queued to its end."""
    with server.store.write() as session:
        while (job := jobs.claim(session, "worker", LEASE, server.now_us)) is not None:
            assert jobs.finish(session, job.id, "worker", job.attempt, GOOD, server.now_us + S)
        for each in ids:
            assert submissions.finish_if_complete(
                session, each, summary(ds, submissions.list_finished_jobs(session, each)), server.now_us + S
            )
