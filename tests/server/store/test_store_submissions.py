"""The life of a submission: quotas, repetitions, ends; on both databases."""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import pytest
from testing import databases
from testing.store_samples import GOOD, LEASE, NOON, PHASE, S, all_of, driven, sent, states, summary, with_teams

from mdrive_sumo.core.errors import InputError
from server.clock import DAY_US, day_start_us
from server.enums import ChallengeTrack, SubmissionState
from server.store import NotFound, NotNow, OverLimit, Store, audit, jobs, phases, quota, submissions
from server.store.tables import JobRow, StandingRow, SubmissionRow


@pytest.fixture(params=databases.BACKENDS)
def store(request: pytest.FixtureRequest) -> Store:
    return databases.emptied(request.param)


@pytest.fixture
def red(store: Store) -> str:
    return with_teams(store, "red")[0]


def test_an_accepted_submission_waits_with_its_jobs(store: Store, red: str) -> None:
    with store.write() as session:
        submission = sent(session, red, jobs=[("a", 0), ("a", 1), ("b", 0)])
    with store.read() as session:
        assert submissions.get(session, submission.id).state == SubmissionState.QUEUED
        assert [(job.scenario, job.seed, job.state) for job in all_of(session, JobRow)] == [
            ("a", 0, "queued"),
            ("a", 1, "queued"),
            ("b", 0, "queued"),
        ]
        assert audit.verify_chain(session).broken is None


@pytest.mark.slow
def test_the_quota_of_a_day_is_of_a_utc_day(store: Store, red: str) -> None:
    last = day_start_us(NOON) + DAY_US - 1
    with store.write() as session:
        for number in range(3):
            driven(session, sent(session, red, NOON + number), NOON + number)
        with pytest.raises(OverLimit, match=r"the 3 submissions of today are used.*2024-10-05 00:00:00 UTC") as over:
            sent(session, red, last)
        assert (over.value.kind, over.value.retry_us) == ("day", last + 1)
        assert sent(session, red, last + 1).state == SubmissionState.QUEUED


@pytest.mark.parametrize(
    ("public", "scored", "counts"), [(True, False, False), (True, True, True), (False, False, True)]
)
def test_a_rejection_before_any_result_is_a_refused_upload(
    store: Store, public: bool, scored: bool, counts: bool
) -> None:
    """But not in a hidden phase, where every start may tell something, nor after work of the evaluator."""
    (red,) = with_teams(store, "red", phase=replace(PHASE, public=public))
    with store.write() as session:
        submission = sent(session, red)
        if scored:
            job = jobs.claim(session, "worker", LEASE, NOON)
            assert job is not None and jobs.finish(session, job.id, "worker", job.attempt, GOOD, NOON)
        submissions.reject(session, submission.id, "sensor 'rgb': expected another", NOON)
        assert submission.counts is counts
        assert quota.count_used(session, red, PHASE.id, NOON).today == counts
        assert quota.count_refused(session, red, NOON) == (not counts)
        assert audit.verify_chain(session).broken is None


def test_the_quota_in_parallel_is_free_again_after_an_end(store: Store, red: str) -> None:
    with store.write() as session:
        first, _ = sent(session, red, NOON), sent(session, red, NOON + 1)
        with pytest.raises(OverLimit, match="2 of at most 2 submissions at a time") as over:
            sent(session, red, NOON + 2)
        assert over.value.kind == "parallel" and (over.value.retry_us or 0) > NOON + 2
        submissions.reject(session, first.id, "it wants the whole frame", NOON + 3)
        assert sent(session, red, NOON + 4)


def test_the_quota_in_total_never_comes_back(store: Store) -> None:
    (red,) = with_teams(store, "red", phase=replace(PHASE, in_total=1))
    with store.write() as session:
        driven(session, sent(session, red), NOON)
        with pytest.raises(OverLimit, match="all 1 submissions are used") as over:
            sent(session, red, NOON + 10 * DAY_US)
        assert (over.value.kind, over.value.retry_us) == ("total", None)


def test_quotas_are_of_a_team_in_a_phase(store: Store) -> None:
    small = replace(PHASE, per_day=1)
    red, blue = with_teams(store, "red", "blue", phase=small)
    with store.write() as session:
        phases.set_phases(session, [replace(small, id="test")], NOON)
        assert sent(session, red) and sent(session, blue) and sent(session, red, phase="test")
        with pytest.raises(OverLimit):
            sent(session, red, NOON + 1)


def test_many_at_once_do_not_pass_the_quota(store: Store, red: str) -> None:
    """Each in its own transaction, all at the same moment: exactly as many as the quota allows are taken."""

    def post(number: int) -> bool:
        try:
            with store.write() as session:
                sent(session, red, NOON + number)
        except OverLimit:
            return False
        return True

    with ThreadPoolExecutor(8) as pool:
        taken = list(pool.map(post, range(8)))
    assert sum(taken) == PHASE.in_parallel
    with store.read() as session:
        assert len(all_of(session, SubmissionRow)) == PHASE.in_parallel


@pytest.mark.slow
def test_our_failure_costs_nothing_and_an_unstarted_cancellation_one_of_the_day(store: Store, red: str) -> None:
    with store.write() as session:
        failed, unstarted = (sent(session, red, NOON + number).id for number in range(2))
        submissions.fail(session, failed, "our fault", NOON)
        submissions.cancel(session, unstarted, NOON)
        started = sent(session, red, NOON + 2).id
        assert jobs.claim(session, "w", LEASE, NOON) is not None
        submissions.cancel(session, started, NOON)
        assert [submissions.get(session, id_).counts for id_ in (failed, unstarted, started)] == [False, False, True]
        assert quota.count_used(session, red, PHASE.id, NOON) == quota.QuotaUsage(today=2, in_parallel=0, in_total=1)
        driven(session, sent(session, red, NOON + 3), NOON)
        with pytest.raises(OverLimit, match="3 submissions of today are used"):
            sent(session, red, NOON + 4)


def test_an_idempotency_key_gives_the_same_submission(store: Store, red: str) -> None:
    (blue,) = with_teams(store, "blue")
    with store.write() as session:
        first = sent(session, red, NOON, archive_sha256="b" * 64, idempotency_key="k")
        assert sent(session, red, NOON + DAY_US, archive_sha256="b" * 64, idempotency_key="k") is first
        with pytest.raises(InputError, match="idempotency key: expected the same archive"):
            sent(session, red, NOON, archive_sha256="c" * 64, idempotency_key="k")
        assert sent(session, blue, NOON, archive_sha256="b" * 64, idempotency_key="k") is not first
        assert len(all_of(session, SubmissionRow)) == 2


@pytest.mark.parametrize("changed", [{"idempotency_key": ""}, {"idempotency_key": "k" * 81}, {"name": "a\x00"}])
def test_unusable_text_is_refused_and_nothing_kept(store: Store, red: str, changed: dict[str, str]) -> None:
    with pytest.raises(InputError, match="printable characters"), store.write() as session:
        sent(session, red, **changed)
    with store.read() as session:
        assert all_of(session, SubmissionRow) == []


@pytest.mark.slow
def test_the_same_archive_is_answered_with_the_finished_one(store: Store, red: str) -> None:
    same = {"archive_sha256": "b" * 64}
    (blue,) = with_teams(store, "blue")
    with store.write() as session:
        first = sent(session, red, NOON, **same)
        driven(session, first, NOON)
        assert sent(session, red, NOON + 1, **same) is first
        others = [
            sent(session, blue, NOON + 2, **same),
            sent(session, red, NOON + 3, **same, track=ChallengeTrack.SHARING),
            sent(session, red, NOON + 4, **same, evaluator={"version": "2"}),
        ]
        assert first not in others
        submissions.disqualify(session, first.id, "hard-coded answers", NOON)
        assert sent(session, red, NOON + 5, **same) is first


def test_what_did_not_finish_can_be_sent_again(store: Store, red: str) -> None:
    with store.write() as session:
        first = sent(session, red, NOON, archive_sha256="b" * 64)
        submissions.cancel(session, first.id, NOON)
        assert sent(session, red, NOON, archive_sha256="b" * 64) is not first


def test_it_is_done_once_when_all_jobs_are(store: Store, red: str) -> None:
    with store.write() as session:
        submission = sent(session, red)
        for expected in (False, True):
            job = jobs.claim(session, "w", LEASE, NOON)
            assert job is not None and not submissions.finish_if_complete(session, submission.id, summary(1), NOON)
            jobs.finish(session, job.id, "w", 1, GOOD, NOON + S)
            assert submissions.finish_if_complete(session, submission.id, summary(80), NOON + S) is expected
        assert not submissions.finish_if_complete(session, submission.id, summary(1), NOON)
        assert (submission.state, submission.ds, submission.finished_us) == ("done", 80.0, NOON + S)
        assert submission.summary == summary(80)


def test_the_summary_is_made_of_the_jobs_in_order(store: Store, red: str) -> None:
    with store.write() as session:
        submission = sent(session, red, jobs=[("b", 1), ("b", 0), ("a", 0)])
        while (job := jobs.claim(session, "w", LEASE, NOON)) is not None:
            assert not submissions.is_complete(session, submission.id)
            jobs.finish(session, job.id, "w", 1, GOOD, NOON)
        assert submissions.is_complete(session, submission.id)
        assert submissions.list_complete(session) == [submission.id]
        seen = [(job.scenario, job.seed, job.result) for job in submissions.list_finished_jobs(session, submission.id)]
        assert submissions.finish_if_complete(session, submission.id, summary(80), NOON)
        assert not submissions.is_complete(session, submission.id) and submissions.list_complete(session) == []
    assert seen == [("a", 0, GOOD.result), ("b", 0, GOOD.result), ("b", 1, GOOD.result)]


def test_a_result_that_is_no_number_finishes_nothing(store: Store, red: str) -> None:
    with store.write() as session:
        submission = sent(session, red)
    with pytest.raises(ValueError, match="finite"), store.write() as session:
        driven(session, submissions.get(session, submission.id), NOON, ds=float("nan"))
    with store.read() as session:
        assert (submissions.get(session, submission.id).state, states(session, submission.id)) == (
            "queued",
            ["queued"] * 2,
        )


@pytest.mark.slow
@pytest.mark.parametrize("end", ["cancel", "reject", "fail", "disqualify"])
def test_every_early_end_stops_the_jobs_and_says_why(store: Store, red: str, end: str) -> None:
    with store.write() as session:
        submission = sent(session, red)
        job = jobs.claim(session, "w", LEASE, NOON)
        assert job is not None
        why = () if end == "cancel" else ("because",)
        getattr(submissions, end)(session, submission.id, *why, NOON + S)
        assert states(session, submission.id) == ["cancelled"] * 2
        assert not jobs.heartbeat(session, job.id, "w", 1, LEASE, NOON + S)
        assert not jobs.finish(session, job.id, "w", 1, GOOD, NOON + S)
        assert submission.why == "".join(why) and submission.finished_us == NOON + S
        assert submissions.list_events(session, submission.id)[-1].data == {"state": submission.state} | (
            {"why": "because"} if why else {}
        )
        for again in (submissions.cancel, lambda *of: submissions.reject(of[0], of[1], "late", of[2])):
            with pytest.raises(NotNow, match=f"it is {submission.state} and can no longer be"):
                again(session, submission.id, NOON)
        submissions.fail(session, submission.id, "late", NOON)
        assert submission.why == "".join(why)


def test_a_disqualified_one_leaves_the_leaderboard(store: Store, red: str) -> None:
    with store.write() as session:
        submission = sent(session, red)
        driven(session, submission, NOON)
        assert len(all_of(session, StandingRow)) == 4
        submissions.set_shown(session, submission.id, False, NOON)
        assert all_of(session, StandingRow) == []
        submissions.set_shown(session, submission.id, True, NOON)
        submissions.disqualify(session, submission.id, "hard-coded answers", NOON)
        assert all_of(session, StandingRow) == []
        assert submission.ds == 80.0


@pytest.mark.slow
def test_a_rerun_keeps_both_and_counts_nowhere(store: Store, red: str) -> None:
    with store.write() as session:
        old = sent(session, red)
        driven(session, old, NOON)
        grown = [("left-turn", 0), ("merge", 0), ("roundabout", 0)]
        new = submissions.rerun(session, old.id, {"version": "2"}, grown, NOON + S)
        assert len(states(session, new.id)) == 3
        assert (new.archive_sha256, new.evaluator, new.counts, new.shown) == (
            old.archive_sha256,
            {"version": "2"},
            False,
            False,
        )
        driven(session, new, NOON + S, ds=70.0)
        assert (old.ds, new.ds) == (80.0, 70.0)
        assert {score.submission for score in all_of(session, StandingRow)} == {old.id}


def test_what_does_not_exist(store: Store) -> None:
    (red,) = with_teams(store, "red")
    with store.write() as session:
        with pytest.raises(NotFound, match="there is no 'x'"):
            submissions.get(session, "x")
        with pytest.raises(NotFound, match="team"):
            sent(session, "nobody")
        with pytest.raises(ValueError, match="at least one job"):
            sent(session, red, jobs=[])
