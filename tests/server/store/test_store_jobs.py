"""Jobs are claimed fairly and scored exactly once, whatever happens to workers; on both databases."""

from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from testing import databases
from testing.store_samples import GOOD, JOBS, LEASE, NOON, PHASE, S, all_of, sent, states, summary, with_teams

from mdrive_sumo.core.state import FailureReason
from server.clock import DAY_US
from server.enums import JobState, ScenarioVerdict, SubmissionState
from server.store import NotFound, Store, jobs, phases, submissions
from server.store.jobs import MAX_FAILURES, JobOutcome
from server.store.tables import JobRow, SubmissionRow

WIDE = replace(PHASE, per_day=1000, in_parallel=1000, in_total=1000)


@pytest.fixture(params=databases.BACKENDS)
def store(request: pytest.FixtureRequest) -> Store:
    return databases.emptied(request.param)


def claimed(store: Store, owner: str = "w", now_us: int = NOON) -> JobRow:
    with store.write() as session:
        job = jobs.claim(session, owner, LEASE, now_us)
    assert job is not None
    return job


def test_a_claim_gives_every_job_once_with_a_lease(store: Store) -> None:
    (red,) = with_teams(store, "red")
    with store.write() as session:
        submission = sent(session, red).id
    first, second = claimed(store, "one"), claimed(store, "two")
    assert {first.scenario, second.scenario} == {"left-turn", "merge"}
    assert (first.owner, first.attempt, first.lease_us, first.started_us) == ("one", 1, NOON + LEASE, NOON)
    with store.write() as session:
        assert jobs.claim(session, "three", LEASE, NOON) is None
        assert states(session, submission) == ["running"] * 2
        assert submissions.get(session, submission).state == SubmissionState.RUNNING


def test_the_team_with_the_fewest_running_is_next(store: Store) -> None:
    """Red sent two submissions before blue sent its first: blue's jobs take turns with them all the same."""
    red, blue = with_teams(store, "red", "blue", phase=WIDE)
    with store.write() as session:
        team_of = {sent(session, red, NOON + n, jobs=[("a", 0), ("b", 0), ("c", 0)]).id: "red" for n in range(2)}
        team_of[sent(session, blue, NOON + 9, jobs=[("a", 0), ("b", 0)]).id] = "blue"
    order = [team_of[claimed(store).submission] for _ in range(8)]
    assert order == ["red", "blue", "red", "blue", "red", "red", "red", "red"]


def test_within_a_team_the_oldest_is_next_and_hidden_phases_come_first(store: Store) -> None:
    (red,) = with_teams(store, "red", phase=WIDE)
    with store.write() as session:
        phases.set_phases(session, [replace(WIDE, id="test", public=False)], NOON)
        later, earlier = sent(session, red, NOON + 2).id, sent(session, red, NOON + 1).id
        hidden = sent(session, red, NOON + 3, phase="test").id
    assert [claimed(store).submission for _ in range(6)] == [hidden] * 2 + [earlier] * 2 + [later] * 2


def test_a_result_is_kept_with_all_that_belongs_to_it(store: Store) -> None:
    (red,) = with_teams(store, "red")
    with store.write() as session:
        submission = sent(session, red).id
    job = claimed(store)
    outcome = JobOutcome(ScenarioVerdict.AGENT_FAILED, {"ds": 3.5, "sr": 0.0}, FailureReason.TIMEOUT, {"cpu_s": 1.5})
    with store.write() as session:
        assert jobs.finish(session, job.id, "w", 1, outcome, NOON + S)
        assert not jobs.finish(session, job.id, "w", 1, GOOD, NOON + S)
    with store.read() as session:
        kept = jobs.get(session, job.id)
        assert (kept.state, kept.verdict, kept.reason) == (JobState.DONE, "agent-failed", "timeout")
        assert (kept.result, kept.usage, kept.finished_us) == ({"ds": 3.5, "sr": 0.0}, {"cpu_s": 1.5}, NOON + S)
        told = [(event.kind, event.data) for event in submissions.list_events(session, submission)][-1]
    assert told == (
        "scenario",
        {"scenario": "left-turn", "seed": 0, "verdict": "agent-failed", "reason": "timeout", "ds": 3.5, "sr": 0.0},
    )


def test_of_a_hidden_phase_events_tell_states_only(store: Store) -> None:
    (red,) = with_teams(store, "red", phase=replace(PHASE, public=False))
    with store.write() as session:
        submission = sent(session, red, jobs=[("planted-marker", 0)]).id
    job = claimed(store)
    with store.write() as session:
        jobs.finish(session, job.id, "w", 1, GOOD, NOON + S)
        submissions.finish_if_complete(session, submission, summary(1), NOON + S)
        told = [(event.kind, event.data) for event in submissions.list_events(session, submission)]
    assert told == [("state", {"state": name}) for name in ("queued", "running", "done")]


def test_a_heartbeat_prolongs_only_ones_own_job(store: Store) -> None:
    (red,) = with_teams(store, "red")
    with store.write() as session:
        sent(session, red)
    job = claimed(store)
    with store.write() as session:
        assert jobs.heartbeat(session, job.id, "w", 1, LEASE, NOON + 50 * S)
        assert jobs.get(session, job.id).lease_us == NOON + 50 * S + LEASE
        for owner, attempt in (("other", 1), ("w", 2), ("w", 0)):
            assert not jobs.heartbeat(session, job.id, owner, attempt, LEASE, NOON + 50 * S)
            assert not jobs.finish(session, job.id, owner, attempt, GOOD, NOON)
            assert not jobs.record_failure(session, job.id, owner, attempt, "mine", NOON)
            assert not jobs.release(session, job.id, owner, attempt)
        assert jobs.reclaim_expired(session, NOON + 100 * S) == 0
        assert jobs.get(session, job.id).state == JobState.RUNNING
        with pytest.raises(NotFound, match="there is no 123456"):
            jobs.get(session, 123456)


def test_the_job_of_a_dead_worker_is_driven_again_and_scored_once(store: Store) -> None:
    (red,) = with_teams(store, "red")
    with store.write() as session:
        sent(session, red, jobs=JOBS[:1])
    first = claimed(store, "dead")
    second = claimed(store, "alive", NOON + LEASE + 1)
    assert (second.id, second.attempt, second.owner, second.failures) == (first.id, 2, "alive", 1)
    late = JobOutcome(ScenarioVerdict.OK, {"ds": 1.0})
    with store.write() as session:
        assert not jobs.finish(session, first.id, "dead", 1, late, NOON + LEASE + 2)
        assert jobs.finish(session, first.id, "alive", 2, GOOD, NOON + LEASE + 3)
        assert not jobs.finish(session, first.id, "dead", 1, late, NOON + LEASE + 4)
        assert jobs.get(session, first.id).result == GOOD.result


def test_the_same_worker_with_an_old_attempt_is_a_late_twin_too(store: Store) -> None:
    (red,) = with_teams(store, "red")
    with store.write() as session:
        sent(session, red, jobs=JOBS[:1])
    job = claimed(store)
    with store.write() as session:
        assert jobs.release(session, job.id, "w", 1)
    assert claimed(store).attempt == 2
    with store.write() as session:
        assert not jobs.finish(session, job.id, "w", 1, GOOD, NOON)
        assert jobs.finish(session, job.id, "w", 2, GOOD, NOON)


@pytest.mark.parametrize("jump_us", [-DAY_US, DAY_US])
def test_a_jumping_clock_scores_once(store: Store, jump_us: int) -> None:
    (red,) = with_teams(store, "red")
    with store.write() as session:
        sent(session, red, jobs=JOBS[:1])
    job = claimed(store)
    with store.write() as session:
        other = jobs.claim(session, "other", LEASE, NOON + jump_us)
        done = [jobs.finish(session, job.id, "w", 1, GOOD, NOON + jump_us)]
        done += [jobs.finish(session, other.id, "other", other.attempt, GOOD, NOON)] if other else []
    assert sum(done) == 1


@pytest.mark.slow
@pytest.mark.parametrize("how", ["lease", "give back", "outcome"])
def test_three_failures_of_ours_end_the_submission_without_cost(store: Store, how: str) -> None:
    (red,) = with_teams(store, "red")
    with store.write() as session:
        submission = sent(session, red).id
    job_ids: set[int] = set()
    for attempt in range(1, MAX_FAILURES + 1):
        now_us = NOON + attempt * 2 * LEASE
        job = claimed(store, now_us=now_us)
        job_ids.add(job.id)
        assert (job.attempt, job.failures) == (attempt, attempt - 1)
        with store.write() as session:
            if how == "lease":
                assert jobs.reclaim_expired(session, now_us + LEASE + 1) == 1
            elif how == "give back":
                assert jobs.record_failure(session, job.id, "w", attempt, "SUMO crashed", now_us)
            else:
                assert jobs.finish(
                    session,
                    job.id,
                    "w",
                    attempt,
                    JobOutcome(ScenarioVerdict.FAILED_OURS, None, failure="SUMO crashed"),
                    now_us,
                )
    (job_id,) = job_ids
    with store.read() as session:
        found, failed = submissions.get(session, submission), jobs.get(session, job_id)
        assert (found.state, found.counts) == (SubmissionState.FAILED_OURS, False)
        assert "does not count" in found.why and "SUMO" not in found.why
        assert (failed.state, failed.verdict) == (JobState.FAILED, ScenarioVerdict.FAILED_OURS)
        assert ("lease of w" if how == "lease" else "SUMO crashed") in failed.failure
        assert states(session, submission) == ["failed", "cancelled"]


def test_a_sweep_of_several_failing_jobs_of_one_submission(store: Store) -> None:
    (red,) = with_teams(store, "red")
    with store.write() as session:
        submission = sent(session, red).id
    for attempt in range(MAX_FAILURES):
        for _ in JOBS:
            claimed(store, now_us=NOON + attempt * 2 * LEASE)
    with store.write() as session:
        assert jobs.reclaim_expired(session, NOON + 10 * LEASE) == 2
        assert Counter(states(session, submission)) == {"failed": 1, "cancelled": 1}
        assert submissions.get(session, submission).state == SubmissionState.FAILED_OURS


def test_a_graceful_shutdown_is_no_failure(store: Store) -> None:
    (red,) = with_teams(store, "red")
    with store.write() as session:
        sent(session, red, jobs=JOBS[:1])
    for attempt in range(1, 2 * MAX_FAILURES):
        job = claimed(store)
        assert (job.attempt, job.failures) == (attempt, 0)
        with store.write() as session:
            assert jobs.release(session, job.id, "w", attempt)


def test_an_outcome_without_result_is_our_failure() -> None:
    for verdict, result in (
        (ScenarioVerdict.OK, None),
        (ScenarioVerdict.AGENT_FAILED, None),
        (ScenarioVerdict.FAILED_OURS, {"ds": 1.0}),
    ):
        with pytest.raises(ValueError, match="expected a result"):
            JobOutcome(verdict, result)


@pytest.mark.slow
def test_many_claimers_get_every_job_once(store: Store) -> None:
    """Eight workers of three teams' 20 jobs, a fifth of which they give back: all done, none twice."""
    teams = with_teams(store, "red", "blue", "green", phase=WIDE)
    with store.write() as session:
        for number in range(4):
            sent(session, teams[number % 3], NOON + number, jobs=[(f"s{n}", 0) for n in range(5)])

    def work(owner: str) -> list[int]:
        finished: list[int] = []
        while True:
            with store.write() as session:
                job = jobs.claim(session, owner, LEASE, NOON)
            if job is None:
                return finished
            with store.write() as session:
                if job.attempt == 1 and job.id % 5 == 0:
                    assert jobs.record_failure(session, job.id, owner, 1, "once", NOON)
                elif jobs.finish(session, job.id, owner, job.attempt, GOOD, NOON):
                    finished.append(job.id)
                submissions.finish_if_complete(session, job.submission, summary(50), NOON)

    with ThreadPoolExecutor(8) as pool:
        finished = Counter(job for found in pool.map(work, [f"worker-{n}" for n in range(8)]) for job in found)
    assert len(finished) == 20 and set(finished.values()) == {1}
    with store.read() as session:
        assert {job.attempt for job in all_of(session, JobRow)} == {1, 2}
        assert [submission.state for submission in all_of(session, SubmissionRow)] == ["done"] * 4
