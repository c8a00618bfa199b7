"""The life of submissions and jobs against a small model of it: random deeds in random order, on both databases."""

import itertools

import pytest
from hypothesis import HealthCheck, Phase, settings
from hypothesis import strategies as st
from hypothesis.stateful import (
    RuleBasedStateMachine,
    initialize,
    invariant,
    precondition,
    rule,
    run_state_machine_as_test,
)
from sqlalchemy import func, select
from testing import databases
from testing.store_samples import LEASE, NOON, PHASE, S, all_of, sent, summary, with_teams

from server.enums import JobState, ScenarioVerdict, SubmissionState
from server.store import OverLimit, audit, jobs, quota, submissions
from server.store.jobs import MAX_FAILURES, JobOutcome
from server.store.row_check import find_row_differences
from server.store.tables import EventRow, JobRow, SubmissionRow

pytestmark = pytest.mark.slow

OPEN = {SubmissionState.QUEUED, SubmissionState.RUNNING}
MOVES = {
    SubmissionState.QUEUED: {
        SubmissionState.QUEUED,
        SubmissionState.RUNNING,
        SubmissionState.CANCELLED,
        SubmissionState.REJECTED,
        SubmissionState.FAILED_OURS,
        SubmissionState.DISQUALIFIED,
    },
    SubmissionState.RUNNING: {
        SubmissionState.RUNNING,
        SubmissionState.DONE,
        SubmissionState.CANCELLED,
        SubmissionState.REJECTED,
        SubmissionState.FAILED_OURS,
        SubmissionState.DISQUALIFIED,
    },
    SubmissionState.DONE: {SubmissionState.DONE, SubmissionState.DISQUALIFIED},
    SubmissionState.FAILED_OURS: {SubmissionState.FAILED_OURS, SubmissionState.DISQUALIFIED},
    SubmissionState.CANCELLED: {SubmissionState.CANCELLED, SubmissionState.DISQUALIFIED},
    SubmissionState.REJECTED: {SubmissionState.REJECTED, SubmissionState.DISQUALIFIED},
    SubmissionState.DISQUALIFIED: {SubmissionState.DISQUALIFIED},
}
"""What a submission may be after one step: `break_three_times` starts it and fails it in one."""


class Challenge(RuleBasedStateMachine):
    """Workers hold claims here long after they lost them, and try to use them."""

    backend = "sqlite"

    @initialize()
    def begin(self) -> None:
        self.store = databases.emptied(self.backend)
        numbers = itertools.count()  # ids that are alike in every run: they decide between submissions of one moment
        self.patches = pytest.MonkeyPatch()
        self.patches.setattr(submissions, "new_id", lambda: f"{next(numbers):032x}")
        self.teams = with_teams(self.store, "red", "blue")
        self.now_us = NOON
        self.sent = 0
        self.held: list[tuple[int, int, str]] = []
        """Every claim ever made: job, attempt, owner."""
        self.scored: dict[int, float] = {}
        self.seen: dict[str, SubmissionState] = {}

    def teardown(self) -> None:
        if hasattr(self, "patches"):
            self.patches.undo()

    @rule(team=st.integers(0, 1))
    def send(self, team: int) -> None:
        self.sent += 1
        with self.store.write() as session:
            before = quota.count_used(session, self.teams[team], PHASE.id, self.now_us)
            full = before.today >= PHASE.per_day or before.in_parallel >= PHASE.in_parallel
            try:
                sent(session, self.teams[team], self.now_us, archive_sha256=f"{self.sent:064x}")
            except OverLimit:
                assert full
            else:
                assert not full

    @rule()
    def claim(self) -> None:
        with self.store.write() as session:
            job = jobs.claim(session, owner := f"worker-{len(self.held)}", LEASE, self.now_us)
            if job is None:
                assert not session.scalar(select(func.count()).where(JobRow.state == JobState.QUEUED))
            else:
                assert job.id not in self.scored
                self.held.append((job.id, job.attempt, owner))

    @precondition(lambda self: self.held)
    @rule(data=st.data(), ds=st.floats(0, 100))
    def finish(self, data: st.DataObject, ds: float) -> None:
        job_id, attempt, owner = data.draw(st.sampled_from(self.held))
        with self.store.write() as session:
            if jobs.finish(session, job_id, owner, attempt, JobOutcome(ScenarioVerdict.OK, {"ds": ds}), self.now_us):
                assert job_id not in self.scored, "scored twice"
                self.scored[job_id] = ds
            submission = jobs.get(session, job_id).submission
            submissions.finish_if_complete(session, submission, summary(ds), self.now_us)

    @precondition(lambda self: self.held)
    @rule(data=st.data(), deed=st.sampled_from(["heartbeat", "give back", "release"]))
    def use(self, data: st.DataObject, deed: str) -> None:
        job_id, attempt, owner = data.draw(st.sampled_from(self.held))
        with self.store.write() as session:
            holds = jobs.get(session, job_id)
            mine = (holds.state, holds.owner, holds.attempt) == (JobState.RUNNING, owner, attempt)
            if deed == "heartbeat":
                assert jobs.heartbeat(session, job_id, owner, attempt, LEASE, self.now_us) is mine
            elif deed == "give back":
                assert jobs.record_failure(session, job_id, owner, attempt, "ours", self.now_us) is mine
            else:
                assert jobs.release(session, job_id, owner, attempt) is mine

    @rule()
    def break_three_times(self) -> None:
        """The whole machine fails for a while: random single failures would seldom meet in one job."""
        for _ in range(MAX_FAILURES):
            with self.store.write() as session:
                if (job := jobs.claim(session, "broken", LEASE, self.now_us)) is not None:
                    assert jobs.record_failure(session, job.id, "broken", job.attempt, "SUMO crashed", self.now_us)

    @rule(seconds=st.sampled_from([1, 30, 61, 3600, -30]))
    def pass_time(self, seconds: int) -> None:
        self.now_us += seconds * S

    @rule()
    def sweep(self) -> None:
        with self.store.write() as session:
            jobs.reclaim_expired(session, self.now_us)
            late = select(func.count()).where(JobRow.state == JobState.RUNNING, JobRow.lease_us < self.now_us)
            assert not session.scalar(late)

    @precondition(lambda self: self.seen)
    @rule(data=st.data(), deed=st.sampled_from(["cancel", "reject", "disqualify"]))
    def end(self, data: st.DataObject, deed: str) -> None:
        id_ = data.draw(st.sampled_from(sorted(self.seen)))
        if deed == "disqualify" or self.seen[id_] in OPEN:
            with self.store.write() as session:
                getattr(submissions, deed)(session, id_, *([] if deed == "cancel" else ["why"]), self.now_us)

    @invariant()
    def everything_fits(self) -> None:
        if not hasattr(self, "store"):
            return
        with self.store.read() as session:
            found: dict[str, list[JobRow]] = {submission.id: [] for submission in all_of(session, SubmissionRow)}
            for job in all_of(session, JobRow):
                found[job.submission].append(job)
                self._job_fits(job)
            for submission in all_of(session, SubmissionRow):
                self._submission_fits(submission, {JobState(job.state) for job in found[submission.id]})
            assert audit.verify_chain(session).broken is None
            assert not list(find_row_differences(session))
            assert session.scalar(select(func.count()).where(EventRow.kind == "scenario")) == len(self.scored)

    def _job_fits(self, job: JobRow) -> None:
        running = job.state == JobState.RUNNING
        assert (job.lease_us is not None) == running
        assert job.owner is not None or not running
        assert job.failures <= min(job.attempt, MAX_FAILURES)
        assert (job.state == JobState.FAILED) == (job.failures == MAX_FAILURES)
        assert (job.state == JobState.DONE) == (job.id in self.scored)
        assert job.result == ({"ds": self.scored[job.id]} if job.id in self.scored else None)

    def _submission_fits(self, submission: SubmissionRow, states: set[JobState]) -> None:
        state = SubmissionState(submission.state)
        assert state in MOVES[self.seen.get(submission.id, SubmissionState.QUEUED)]
        self.seen[submission.id] = state
        assert (submission.finished_us is None) == (state in OPEN)
        assert state in OPEN or not states & {JobState.QUEUED, JobState.RUNNING}
        if state is SubmissionState.DONE:
            assert states == {JobState.DONE}
        if state is SubmissionState.FAILED_OURS:
            assert JobState.FAILED in states and not submission.counts
        if JobState.FAILED in states:
            assert state in {SubmissionState.FAILED_OURS, SubmissionState.DISQUALIFIED}


@pytest.mark.parametrize(("backend", "examples"), [("sqlite", 5), ("postgresql", 3)])
def test_the_state_machine(backend: str, examples: int) -> None:
    databases.shared(backend)
    machine = type("Machine", (Challenge,), {"backend": backend})
    run_state_machine_as_test(
        machine,
        settings=settings(
            max_examples=examples,
            stateful_step_count=30,
            deadline=None,
            derandomize=True,
            phases=[Phase.generate],  # shrinking a failure takes minutes; the longer test does it
            suppress_health_check=list(HealthCheck),
        ),
    )


@pytest.mark.full
@pytest.mark.parametrize("backend", databases.BACKENDS)
def test_the_state_machine_for_longer(backend: str) -> None:
    databases.shared(backend)
    machine = type("Machine", (Challenge,), {"backend": backend})
    longer = settings(max_examples=150, stateful_step_count=50, deadline=None, suppress_health_check=list(HealthCheck))
    run_state_machine_as_test(machine, settings=longer)
