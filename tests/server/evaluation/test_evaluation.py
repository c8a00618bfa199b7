"""The dispatcher: claims, results, cancellation, failures of ours, shutdown; summaries; what is left on the disk."""

import errno
import shutil
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import patch

import pytest
from testing import databases
from testing.evaluation_bench import Bench, S
from testing.evaluation_fakes import read, scored

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scoring import compute_overall
from server.enums import MIN_HIDDEN_SCENARIOS, ChallengeTrack, JobState, ScenarioVerdict, SubmissionState
from server.evaluation.archive_cache import delete_stale
from server.evaluation.summary import summarise
from server.store import StoreUnavailable, submissions
from server.store.tables import JobRow
from server.tracks import check_style


@pytest.fixture
def bench(tmp_path: Path) -> Generator[Bench]:
    found = Bench(tmp_path, databases.emptied("sqlite"))
    yield found
    found.stop.close()


def test_a_submission_is_driven_scored_and_ranked(bench: Bench) -> None:
    submission = bench.begin("nap", "agent fails", "nap")
    bench.steps(4)
    done = read(bench.store, submission)
    assert done.state == SubmissionState.DONE
    assert [job.verdict for job in bench.rows()] == [
        ScenarioVerdict.OK,
        ScenarioVerdict.AGENT_FAILED,
        ScenarioVerdict.OK,
    ]
    assert [job.reason for job in bench.rows()] == [None, "timeout", None]
    assert done.summary is not None
    assert done.ds == pytest.approx((10 + 0 + 12) / 3)
    assert done.summary["overall"]["scenarios"] == 3
    recorded = bench.settings.recordings / submission / "0" / "s2.npz"
    assert recorded.read_text() == "recorded in attempt 1"
    assert not list((bench.settings.data / "stage").iterdir())


@pytest.mark.slow
def test_of_hidden_phases_nothing_is_kept(bench: Bench) -> None:
    submission = bench.begin(*["nap"] * MIN_HIDDEN_SCENARIOS, public=False)
    bench.steps(MIN_HIDDEN_SCENARIOS + 1)
    assert read(bench.store, submission).state == SubmissionState.DONE
    assert not bench.settings.recordings.exists()


def test_a_rejection_ends_the_whole_submission(bench: Bench) -> None:
    submission = bench.begin("nap", "reject", "nap")
    bench.steps(3)
    rejected = read(bench.store, submission)
    assert rejected.state == SubmissionState.REJECTED
    assert rejected.why == "sensor 'x': expected one that there is, found none"
    assert bench.calls() == 2


def test_our_failure_is_tried_three_times_with_pauses_and_then_costs_nothing(bench: Bench) -> None:
    submission = bench.begin("raise", "nap")
    bench.steps(2)
    assert bench.calls() == 1  # a pause
    bench.steps(40, pause_us=S)
    failed = read(bench.store, submission)
    assert (failed.state, failed.counts) == (SubmissionState.FAILED_OURS, False)
    first, second = bench.rows()
    assert (first.attempt, first.state, first.failure) == (3, JobState.FAILED, "raised: SUMO lost the road")
    assert second.state == JobState.CANCELLED
    assert "SUMO" not in failed.why


def test_a_cancelled_job_is_killed_with_the_next_heartbeat(bench: Bench) -> None:
    submission = bench.begin("nap", "nap")
    bench.executor.stuck = {"s0"}
    bench.steps(1)
    with bench.store.write() as session:
        submissions.cancel(session, submission, bench.now_us)
    bench.steps(1, pause_us=9 * S)
    assert bench.executor.ended == []
    bench.steps(2, pause_us=S)
    assert bench.executor.ended == ["1.1"]
    assert bench.executor.waiting == {}
    assert read(bench.store, submission).state == SubmissionState.CANCELLED


@pytest.mark.slow
def test_heartbeats_keep_a_long_job_and_a_late_twin_is_dropped(bench: Bench) -> None:
    submission = bench.begin("nap")
    bench.executor.stuck = {"s0"}
    bench.steps(20, pause_us=10 * S)
    other = bench.another("two")
    bench.executor.slots = 2
    other.step(0.0, bench.stop)
    assert bench.rows()[0].attempt == 1  # 200 s later the lease still holds
    bench.now_us += 61 * S  # as if the first slept
    other.step(0.0, bench.stop)
    assert bench.rows()[0].attempt == 2
    late = next(task for task in bench.executor.waiting.values() if task.attempt == 1)
    late.stage.mkdir(parents=True)
    (late.stage / "s0.npz").write_text("late")
    bench.executor.stuck = set()
    bench.dispatcher.step(0.0, bench.stop)  # takes both outcomes, knows only its own
    assert read(bench.store, submission).state == SubmissionState.RUNNING
    assert not (bench.settings.recordings / submission).exists()
    assert not late.stage.exists()


def test_a_stop_gives_jobs_back_without_blame(bench: Bench) -> None:
    bench.begin("nap", "nap")
    bench.executor.stuck, bench.executor.slots = {"s0", "s1"}, 2
    bench.steps(1)
    bench.stop.request()
    bench.dispatcher.run(bench.stop)
    assert [(job.state, job.failures, job.owner) for job in bench.rows()] == [(JobState.QUEUED, 0, None)] * 2
    assert sorted(bench.executor.ended) == ["1.1", "2.1"]


@contextmanager
def without_database(bench: Bench) -> Generator[None]:
    """It is away meanwhile."""
    gone = StoreUnavailable("gone")
    with patch.object(bench.store, "write", side_effect=gone), patch.object(bench.store, "read", side_effect=gone):
        yield


def test_results_wait_for_a_database_that_is_away(bench: Bench) -> None:
    submission = bench.begin("nap")
    bench.dispatcher._claim()

    with without_database(bench):
        bench.steps(3, pause_us=100 * S)  # longer than a lease
    assert read(bench.store, submission).state == SubmissionState.RUNNING
    bench.steps(1)
    assert read(bench.store, submission).state == SubmissionState.DONE
    assert bench.calls() == 1
    assert [(job.attempt, job.failures) for job in bench.rows()] == [(1, 0)]


@pytest.mark.slow
def test_waiting_for_a_database_counts_as_one_failure_of_ours(bench: Bench) -> None:
    """However long: a second between the tries, and a failure of ours is counted once."""
    bench.begin("raise")
    bench.dispatcher._claim()

    with without_database(bench):
        for _ in range(1100):
            bench.dispatcher.step(1.0, bench.stop)
            bench.now_us += S
    assert set(bench.executor.waits) == {1.0}
    bench.steps(1)
    assert [(job.state, job.failures) for job in bench.rows()] == [(JobState.QUEUED, 1)]


def test_a_lease_that_ended_while_the_database_was_away_is_prolonged(bench: Bench) -> None:
    submission = bench.begin("nap", "nap")
    bench.executor.slots = 2  # so that it asks for more work
    bench.executor.stuck = {"s0"}
    bench.steps(1)
    bench.now_us += 100 * S
    bench.steps(1)
    bench.executor.stuck = set()
    bench.steps(2)
    assert read(bench.store, submission).state == SubmissionState.DONE
    assert [(job.attempt, job.failures) for job in bench.rows()] == [(1, 0)] * 2


def test_a_disk_that_is_full_is_our_failure(bench: Bench) -> None:
    submission = bench.begin("nap")
    bench.settings.recordings.write_text("no folder")
    bench.steps(1)
    job = bench.rows()[0]
    assert (job.state, job.failures, job.result) == (JobState.QUEUED, 1, None)
    assert job.failure.startswith("the files of a result: ")
    bench.settings.recordings.unlink()
    bench.steps(3, pause_us=2 * S)
    assert read(bench.store, submission).state == SubmissionState.DONE


@pytest.mark.slow
def test_nothing_is_begun_without_room_on_the_disk(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    submission = bench.begin("nap", "nap")
    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", lambda _: SimpleNamespace(free=2**25))
        bench.steps(50, pause_us=S)
    assert bench.calls() == 0
    assert [(job.state, job.failures) for job in bench.rows()] == [(JobState.QUEUED, 0)] * 2
    bench.steps(20, pause_us=S)
    assert read(bench.store, submission).state == SubmissionState.DONE


def test_a_data_folder_that_is_gone_ends_the_worker(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    bench.begin("nap")

    def gone(_: Path) -> None:
        raise FileNotFoundError(errno.ENOENT, "No such file or directory")

    with monkeypatch.context() as patch:
        patch.setattr(shutil, "disk_usage", gone)
        with pytest.raises(InputError, match=r"^data: expected a folder .*, found none"):
            bench.steps(1)
    assert bench.rows()[0].attempt == 0


def test_a_summary_is_that_of_the_library_with_intervals() -> None:
    results = [scored(f"s{i}", bucket) for i, bucket in enumerate("A" * 10 + "B" * 12)]
    rows = [JobRow(scenario=one.id, seed=0, result=one.model_dump(mode="json")) for one in results]
    summary = summarise(rows)
    assert summary["overall"]["ds"] == compute_overall(results).bucket_mean.ds == pytest.approx((14.5 + 25.5) / 2)
    assert summary["buckets"]["B"]["ds"] == pytest.approx(25.5)
    assert summary["categories"]["deed"]["ds"] == pytest.approx(20.5)
    assert summary["overall"]["ds_low"] < summary["overall"]["ds"] < summary["overall"]["ds_high"]
    assert summary["buckets"]["B"]["ds_low"] >= 20.0
    assert summarise(rows) == summary
    few = summarise(rows[:13])
    assert few["buckets"]["A"]["ds_low"] is not None
    assert few["buckets"]["B"]["ds_low"] is few["overall"]["ds_low"] is None, "three scenarios of B"
    assert (summary["overall"]["efficient_sr"], summary["overall"]["time_ratio"]) == (None, None)


def test_a_summary_has_efficient_sr_only_if_every_scenario_has_a_reference() -> None:
    """Bucket A 50 and 100, B 20: with all of them (75 + 20) / 2; the time ratio is over the scenarios that have one."""

    def row(name: str, bucket: str, efficient_sr: float | None, time_ratio: float | None) -> JobRow:
        times = {"efficient_sr": efficient_sr, "time_ratio": time_ratio}
        return JobRow(result=scored(name, bucket).model_copy(update=times).model_dump(mode="json"))

    rows = [row("s1", "A", 50.0, 1.5), row("s2", "A", 100.0, None), row("s3", "B", 20.0, 2.5)]
    found = summarise(rows)
    assert (found["overall"]["efficient_sr"], found["overall"]["time_ratio"], found["overall"]["timed"]) == (
        47.5,
        2.0,
        2,
    )
    assert (found["buckets"]["A"]["efficient_sr"], found["buckets"]["A"]["timed"]) == (75.0, 1)
    partly = summarise([*rows, row("s4", "B", None, None)])
    assert (partly["overall"]["efficient_sr"], partly["buckets"]["B"]["efficient_sr"]) == (None, None)
    assert partly["buckets"]["A"]["efficient_sr"] == 75.0


def test_a_summary_has_scalar_means_and_the_least_time_to_collision() -> None:
    def row(name: str, min_ttc: float | None, scalars: dict[str, float | None]) -> JobRow:
        changed = scored(name, "A").model_copy(update={"min_ttc": min_ttc, "scalars": scalars})
        return JobRow(result=changed.model_dump(mode="json"))

    rows = [row("s1", 0.4, {"mean_speed": 4.0, "min_pet": 1.0}), row("s2", 0.2, {"mean_speed": 6.0, "min_pet": None})]
    expected = {"min_ttc": 0.2, "mean_speed": 5.0, "min_pet": 1.0}
    found = summarise(rows)
    assert found["overall"]["scalars"] == found["buckets"]["A"]["scalars"] == expected
    assert summarise([row("s1", None, {})])["overall"]["scalars"] == {"min_ttc": None}


def test_only_unused_files_are_deleted(tmp_path: Path) -> None:
    for name in ("unpacked/needed", "unpacked/old", "unpacked/half.made", "stage/s.1.1"):
        (tmp_path / name).mkdir(parents=True)
    now_s = (tmp_path / "stage/s.1.1").stat().st_mtime

    def left_after(hours: float) -> set[str]:
        delete_stale(tmp_path, {"needed"}, now_s + hours * 3600)
        return {path.name for path in tmp_path.glob("*/*")}

    assert left_after(0.9) == {"needed", "old", "half.made", "s.1.1"}
    assert left_after(23) == {"needed", "s.1.1"}  # where a long job may still be writing
    assert left_after(25) == {"needed"}


@pytest.mark.parametrize(
    ("style", "track", "fine"),
    [
        ("joint", ChallengeTrack.JOINT, True),
        ("agent", ChallengeTrack.SINGLE, True),
        ("agent", ChallengeTrack.SHARING, True),
        ("joint", ChallengeTrack.SINGLE, False),
        ("agent", ChallengeTrack.JOINT, False),
    ],
)
def test_joint_agents_are_in_their_own_track(style: str, track: ChallengeTrack, fine: bool) -> None:
    if fine:
        check_style(style, track)
    else:
        with pytest.raises(InputError, match=rf"^track {track}: expected "):
            check_style(style, track)
