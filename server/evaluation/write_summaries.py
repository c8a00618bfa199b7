"""Writes the summary of a submission when all jobs are done, outside of the transaction that finishes the last one."""

from collections.abc import Callable

from sqlalchemy.orm import Session

from server.evaluation.summary import summarise
from server.evaluation.thinking_times import record_thinking_flag
from server.store import Store, submissions

OnDone = Callable[[Session, str], None]
"""What else to do in the transaction that marks a submission done."""


def write_summary(store: Store, submission: str, clock: Callable[[], int], on_done: OnDone) -> None:
    """Write the summary of a complete submission; it is computed before the write transaction begins.

    Does nothing for a submission that is not complete, or that another worker has finished. Raises StoreUnavailable.
    """
    with store.read() as session:
        if not submissions.is_complete(session, submission):
            return
        summary = summarise(submissions.list_finished_jobs(session, submission))
    with store.write() as session:
        if submissions.finish_if_complete(session, submission, summary, clock()):
            on_done(session, submission)  # first: the hash of the entry `submission-done` draws the spot checks
            record_thinking_flag(session, submission, clock())


def write_left_over_summaries(store: Store, clock: Callable[[], int], on_done: OnDone) -> None:
    """Write the summaries that another worker died before writing. Raises StoreUnavailable."""
    with store.read() as session:
        found = submissions.list_complete(session)
    for submission in found:
        write_summary(store, submission, clock, on_done)
