"""Driven anew: spot checks, and what another version of the evaluator has begun."""

import json
import os
import shutil
from collections.abc import Generator
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from testing import databases, evaluation_fakes
from testing.evaluation_bench import Bench, Inline, S
from testing.evaluation_fakes import fake, read, scored, submitted
from testing.local_executor import LocalExecutor
from testing.paths import TESTS
from testing.suite_fakes import make_suite

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.state import FailureReason
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.scenario.suite import SCENARIO_FILE
from server import environments
from server.clock import DAY_US
from server.enums import JobKind, JobState, ScenarioVerdict, SubmissionState
from server.evaluation import spot_checks, submission_job
from server.evaluation.dispatcher import EvaluatorMismatchError
from server.evaluation.job_task import AgentRejection, JobResult, JobTask, describe_failure
from server.evaluation.supervisor import requeue_outdated
from server.evaluation.worker import _compute_limit_s
from server.phase_suites import LoadedPhaseSuites
from server.store import audit, phases, submissions
from server.store.jobs import MAX_FAILURES, JobOutcome
from server.store.tables import AuditEntryRow, JobRow

pytestmark = pytest.mark.slow


@pytest.fixture
def bench(tmp_path: Path) -> Generator[Bench]:
    found = Bench(tmp_path, databases.emptied("sqlite"))
    yield found
    found.stop.close()


def add_submission_elsewhere(bench: Bench) -> str:
    """A submission of another phase, whose suite stays."""
    suite = make_suite(bench.folder / "other", "nap")
    with bench.store.write() as session:
        phases.set_phases(session, [phases.NewPhase("q", "Q", str(suite.folder), True, 0, 10**6 * DAY_US, 5, 5, 5)], 1)
    return submitted(bench.store, bench.settings, bench.now_us + 1, phase="q")


def spot_check_rows(bench: Bench) -> list[JobRow]:
    with bench.store.read() as session:
        return list(session.query(JobRow).filter_by(kind=JobKind.SPOT_CHECK))


def test_another_evaluator_s_job_is_refused_until_the_server_renews_it(bench: Bench) -> None:
    submission = bench.begin("nap", "nap")
    bench.steps(1)
    with bench.store.write() as session:
        submissions.get(session, submission).evaluator = {"code": "older"}
    with pytest.raises(EvaluatorMismatchError, match="restart the server"):
        bench.steps(1)
    assert [job.state for job in bench.rows()] == [JobState.DONE, JobState.QUEUED]
    assert requeue_outdated(bench.store, bench.settings, bench.now_us) == 1
    assert requeue_outdated(bench.store, bench.settings, bench.now_us) == 0
    assert [(job.state, job.result) for job in bench.rows()] == [(JobState.QUEUED, None)] * 2
    bench.steps(3)
    assert read(bench.store, submission).state == SubmissionState.DONE
    with bench.store.read() as session:
        assert audit.verify_chain(session).broken is None


def test_a_submission_that_cannot_be_driven_any_more_is_our_failure_and_raises_nothing(bench: Bench) -> None:
    submission = bench.begin("nap")
    (bench.folder / "suite" / "suite.json").unlink()
    assert requeue_outdated(bench.store, bench.settings, bench.now_us) == 0
    found = read(bench.store, submission)
    assert (found.state, found.counts) == (SubmissionState.FAILED_OURS, False)


def test_a_spot_check_whose_suite_is_gone_stops_nothing(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    """Spot checks come first: each worker would claim it again."""
    submission = bench.begin("nap")
    bench.with_spot_checks()
    bench.steps(1)
    other = add_submission_elsewhere(bench)
    (bench.folder / "suite" / "suite.json").unlink()
    bench.dispatcher = bench.another("two")  # with nothing read yet
    bench.steps(2)
    states = {job.submission: job.state for job in spot_check_rows(bench)}
    assert states == {submission: JobState.CANCELLED, other: JobState.DONE}
    assert [check["submission"] for check in bench.spot_checks()] == [other]
    assert read(bench.store, other).state == SubmissionState.DONE
    [said] = [record.message for record in caplog.records if "cancelled" in record.message]
    assert said.startswith(f"submission {submission}: ") and "suite.json" in said
    with bench.store.read() as session:
        assert audit.verify_chain(session).broken is None


def test_the_server_s_start_cancels_spot_checks_whose_suite_is_gone(bench: Bench) -> None:
    bench.begin("nap")
    bench.with_spot_checks()
    bench.steps(1)
    assert requeue_outdated(bench.store, bench.settings, bench.now_us) == 0
    assert [job.state for job in spot_check_rows(bench)] == [JobState.QUEUED]
    (bench.folder / "suite" / "suite.json").unlink()
    assert requeue_outdated(bench.store, bench.settings, bench.now_us) == 0
    assert [job.state for job in spot_check_rows(bench)] == [JobState.CANCELLED]


def test_a_submission_whose_suite_is_gone_fails_on_our_side_and_stops_nothing(bench: Bench) -> None:
    submission = bench.begin("nap")
    other = add_submission_elsewhere(bench)
    (bench.folder / "suite" / "suite.json").unlink()
    bench.dispatcher = bench.another("two")
    bench.steps(20, pause_us=S)
    failed = read(bench.store, submission)
    assert (failed.state, failed.counts) == (SubmissionState.FAILED_OURS, False)
    assert str(bench.folder) not in failed.why
    job = next(job for job in bench.rows() if job.submission == submission)
    assert job.failures == MAX_FAILURES and "suite.json" in job.failure
    assert read(bench.store, other).state == SubmissionState.DONE


def test_a_worker_starts_without_the_suite_of_a_phase_that_is_over(bench: Bench) -> None:
    bench.begin("nap")
    with bench.store.read() as session:
        closes_us = phases.get(session, "p").closes_us
    (bench.folder / "suite" / "suite.json").unlink()
    suites = LoadedPhaseSuites(bench.settings)
    with pytest.raises(InputError, match=r"suite\.json"):
        _compute_limit_s(bench.store, bench.settings, suites, closes_us - 1)
    assert _compute_limit_s(bench.store, bench.settings, suites, closes_us) > 0


def test_verify_skips_a_submission_whose_suite_is_gone(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    submission = bench.begin("nap")
    bench.steps(1)
    (bench.folder / "suite" / "suite.json").unlink()
    assert list(spot_checks.run_spot_checks(bench.store, bench.settings, [submission], lambda: 5, fake)) == []
    assert f"submission {submission}: not checked" in caplog.text


def test_a_failure_on_our_side_without_a_text_is_still_one() -> None:
    assert describe_failure(JobOutcome(ScenarioVerdict.FAILED_OURS, None)) == "unknown"
    assert describe_failure(JobOutcome(ScenarioVerdict.OK, scored("s0").model_dump(mode="json"))) is None
    assert describe_failure(AgentRejection("why")) is None


@pytest.mark.parametrize("deeds", [["nap"], ["nap", "nap", "nap"]], ids=["one-fewer", "one-more"])
def test_what_is_renewed_has_the_jobs_of_the_suite_as_it_is_now(bench: Bench, deeds: list[str]) -> None:
    submission = bench.begin("nap", "nap")
    bench.steps(1)
    shutil.rmtree(bench.folder / "suite")
    make_suite(bench.folder / "suite", *deeds)
    assert requeue_outdated(bench.store, bench.settings, bench.now_us) == 1
    expected = [(f"s{i}", JobState.QUEUED, 1) for i in range(len(deeds))]
    assert [(job.scenario, job.state, job.attempt) for job in bench.rows()] == expected
    bench.dispatcher = bench.another("two")
    bench.steps(4)
    done = read(bench.store, submission)
    assert (done.state, done.summary and done.summary["overall"]["scenarios"]) == (SubmissionState.DONE, len(deeds))


def test_a_scenario_that_changes_under_the_workers_is_our_failure(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """No agent is started: the suite is compared before."""
    submission = bench.begin("nap", "nap")
    path = bench.folder / "suite" / "s0" / SCENARIO_FILE
    agent = SimpleNamespace(manifest=SimpleNamespace(style="agent"), agent_spec=lambda: AgentSpec("idm"))

    def load_agent(_: JobTask) -> SimpleNamespace:
        path.write_bytes(path.read_bytes() + b"\n")
        return agent

    monkeypatch.setattr(submission_job, "_load_agent", load_agent)
    bench.dispatcher = bench.another("two", LocalExecutor(submission_job.run_submission_job))
    bench.steps(10, pause_us=S)
    failed = read(bench.store, submission)
    assert (failed.state, failed.counts) == (SubmissionState.FAILED_OURS, False)
    job, _ = bench.rows()
    said = f"input: {path}: expected the scenario with which the run began, found a changed one"
    assert (job.attempt, job.verdict, job.failure) == (3, ScenarioVerdict.FAILED_OURS, said)
    assert str(bench.folder) not in failed.why


def test_another_content_of_an_environment_is_another_evaluator(bench: Bench) -> None:
    submission = bench.begin("nap", "nap")
    about = bench.settings.environments / "python3.11-numpy" / environments.ABOUT_FILE
    about.parent.mkdir(parents=True)
    seen = [read(bench.store, submission).evaluator["environment"]]
    for packages, image in ([["numpy==1"], ""], [["numpy==2"], ""], [["numpy==2"], "newer"]):
        bench.steps(1)
        about.write_text(json.dumps({"python": "/opt/agent/bin/python", "packages": packages, "image": image}))
        with pytest.raises(EvaluatorMismatchError, match="environment"):
            bench.steps(1)
        assert requeue_outdated(bench.store, bench.settings, bench.now_us) == 1
        seen.append(read(bench.store, submission).evaluator["environment"])
    assert len(set(seen)) == 4
    bench.steps(3)
    about.write_text(json.dumps({"python": "/opt/agent/bin/python", "packages": [], "image": ""}))
    assert list(spot_checks.run_spot_checks(bench.store, bench.settings, [submission], lambda: 5, fake)) == []


def test_failures_under_an_older_version_are_forgiven(bench: Bench) -> None:
    submission = bench.begin("raise")
    bench.steps(2, pause_us=S)
    assert bench.rows()[0].failures == 2
    with bench.store.write() as session:
        submissions.get(session, submission).evaluator = {"code": "older"}
    requeue_outdated(bench.store, bench.settings, bench.now_us)
    [job] = bench.rows()
    assert (job.state, job.failures, job.failure) == (JobState.QUEUED, 0, "")
    assert job.attempt == 2  # never counted anew: a late result of the older version must not fit


def test_a_late_result_of_an_older_version_is_dropped(bench: Bench) -> None:
    submission = bench.begin("nap")
    bench.executor.stuck = {"s0"}
    bench.steps(1)
    with bench.store.write() as session:
        submissions.get(session, submission).evaluator = {"code": "older"}
    requeue_outdated(bench.store, bench.settings, bench.now_us)
    bench.executor.stuck, bench.executor.slots = set(), 0
    bench.steps(1)
    assert bench.calls() == 1
    assert [(job.state, job.result) for job in bench.rows()] == [(JobState.QUEUED, None)]
    assert not (bench.settings.recordings / submission).exists()


def test_a_spot_check_compares_and_tells_only_the_audit_log(bench: Bench) -> None:
    submission = bench.begin("nap", "agent fails")
    bench.with_spot_checks()
    bench.steps(2)
    with bench.store.read() as session:
        told = len(submissions.list_events(session, submission))
    bench.steps(2)
    [found] = bench.spot_checks()
    assert found["same"] is True
    assert bench.calls() == 3
    with bench.store.read() as session:
        assert len(submissions.list_events(session, submission)) == told
        [job] = spot_checks.sample_jobs(session, submission, "any")
    assert job.scenario == "s0"  # the other's agent failed
    assert job.attempt == 1


@pytest.mark.parametrize("change", ["digest", "reason"])
def test_a_result_that_does_not_repeat_itself_is_told(
    bench: Bench, change: str, caplog: pytest.LogCaptureFixture
) -> None:
    bench.begin("nap")
    bench.with_spot_checks()
    bench.steps(1)
    then = bench.rows()[0].result

    def otherwise(task: JobTask) -> JobResult:
        if change == "digest":
            return JobOutcome(ScenarioVerdict.OK, scored("s7").model_dump(mode="json"))
        return JobOutcome(
            ScenarioVerdict.AGENT_FAILED, scored("s0", failed=True).model_dump(mode="json"), FailureReason.TIMEOUT
        )

    bench.executor.function = otherwise
    bench.steps(2)
    [found] = bench.spot_checks()
    text = {"digest": "digest 0000000000000007, was 0000000000000000", "reason": "its agent failed this time: timeout"}
    assert (found["same"], found["text"]) == (False, text[change])
    assert text[change] in caplog.text
    assert bench.rows()[0].result == then  # what was scored stays


def test_spot_checks_do_not_wait_for_an_empty_queue(bench: Bench) -> None:
    bench.begin("nap")
    bench.with_spot_checks()
    for _ in range(5):
        submitted(bench.store, bench.settings, bench.now_us)
        bench.now_us += S
        bench.steps(1)
    assert JobState.QUEUED in {job.state for job in bench.rows()}
    assert len(bench.spot_checks()) >= 2


def test_the_share_of_spot_checks_is_that_of_the_submissions() -> None:
    heads = [os.urandom(32).hex() for _ in range(4000)]
    assert not any(spot_checks.is_drawn(one, 0.0) for one in heads)
    assert all(spot_checks.is_drawn(one, 1.0) for one in heads)
    assert 0.07 < np.mean([spot_checks.is_drawn(one, 0.1) for one in heads]) < 0.13


def test_the_draw_of_a_submission_follows_from_the_audit_log_only_after_its_end(bench: Bench) -> None:
    """What a team is told with its upload must not tell it whether to cancel and send again."""
    bench.begin("nap")
    work = bench.settings.work.model_copy(update={"spot_check": 0.5})
    bench.settings = bench.settings.model_copy(update={"work": work})
    bench.dispatcher = bench.another("one")
    for _ in range(9):
        submitted(bench.store, bench.settings, bench.now_us)
        bench.now_us += S
    bench.steps(24)
    with bench.store.read() as session:
        ends = {e.data["submission"]: e.hash for e in session.query(AuditEntryRow) if e.action == "submission-done"}
    expected = {submission for submission, hash_ in ends.items() if spot_checks.is_drawn(hash_, 0.5)}
    assert len(ends) == 10
    assert 0 < len(expected) < 10
    assert {one["submission"] for one in bench.spot_checks()} == expected


def test_which_scenarios_are_sampled_does_not_follow_from_the_submission(bench: Bench) -> None:
    submission = bench.begin(*["nap"] * 6)
    bench.steps(7)
    with bench.store.read() as session:
        drawn = [spot_checks.sample_jobs(session, submission, str(i))[0].scenario for i in range(40)]
        assert drawn == [spot_checks.sample_jobs(session, submission, str(i))[0].scenario for i in range(40)]
    assert len(set(drawn)) > 1


def test_verify_drives_again_in_a_process(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(TESTS))
    submission = bench.begin("nap", "nap")
    bench.steps(3)
    found = list(
        spot_checks.run_spot_checks(bench.store, bench.settings, [submission], lambda: 5, evaluation_fakes.fake)
    )
    assert [(check.submission, check.same) for check in found] == [(submission, True)]
    with bench.store.read() as session:
        assert spot_checks.list_finished(session, 5) == [submission]


def test_verify_does_not_compare_two_versions(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    submission = bench.begin("nap")
    bench.steps(1)
    with bench.store.write() as session:
        submissions.get(session, submission).evaluator = {"code": "older"}
    assert list(spot_checks.run_spot_checks(bench.store, bench.settings, [submission], lambda: 5, fake)) == []
    assert "run by another version" in caplog.text


def test_a_spot_check_whose_worker_dies_is_done_once_by_another(bench: Bench) -> None:
    """It is a job like any other: its lease ends, and a late result of the dead worker is dropped."""
    submission = bench.begin("nap")
    bench.with_spot_checks()
    bench.steps(1)
    bench.executor.stuck = {"s0"}
    bench.steps(1)
    assert [task.kind for task in bench.executor.waiting.values()] == [JobKind.SPOT_CHECK]
    bench.now_us += 61 * S
    executor = Inline()
    bench.another("two", executor).step(0.0, bench.stop)
    assert [(check["submission"], check["same"]) for check in bench.spot_checks()] == [(submission, True)]
    assert executor.waiting == {}
    bench.executor.stuck = set()
    bench.steps(2)
    assert len(bench.spot_checks()) == 1
    with bench.store.read() as session:
        [check] = session.query(JobRow).filter_by(kind=JobKind.SPOT_CHECK)
    assert (check.state, check.attempt, check.failures) == (JobState.DONE, 2, 1)


def test_a_spot_check_that_fails_on_our_side_is_tried_three_times_and_blames_nobody(bench: Bench) -> None:
    submission = bench.begin("nap")
    bench.with_spot_checks()
    bench.steps(1)

    def break_down(_: JobTask) -> JobResult:
        raise WorldError("SUMO lost the road")

    bench.executor.function = break_down
    bench.steps(40, pause_us=S)
    with bench.store.read() as session:
        [check] = session.query(JobRow).filter_by(kind=JobKind.SPOT_CHECK)
    assert (check.state, check.failures, check.failure) == (JobState.FAILED, 3, "raised: SUMO lost the road")
    assert bench.spot_checks() == [] and read(bench.store, submission).state == SubmissionState.DONE


def test_a_spot_check_of_another_evaluator_is_not_made(bench: Bench, caplog: pytest.LogCaptureFixture) -> None:
    submission = bench.begin("nap")
    bench.with_spot_checks()
    bench.steps(1)
    with bench.store.write() as session:
        submissions.get(session, submission).evaluator = {"code": "older"}
    bench.steps(2)
    assert bench.spot_checks() == [] and "run by another version" in caplog.text
    with bench.store.read() as session:
        assert [job.state for job in session.query(JobRow).filter_by(kind=JobKind.SPOT_CHECK)] == [JobState.CANCELLED]
