"""Bounded work of the evaluation: short write transactions, summaries that nobody is left to write, budgets."""

from collections.abc import Generator, Sequence
from pathlib import Path

import pytest
from sqlalchemy import select
from testing import databases
from testing.evaluation_bench import Bench, S
from testing.evaluation_fakes import read

from server.enums import SubmissionState
from server.evaluation.summary import summarise
from server.store.standings import SummaryData
from server.store.tables import JobRow


@pytest.fixture
def bench(tmp_path: Path) -> Generator[Bench]:
    found = Bench(tmp_path, databases.emptied("sqlite"))
    yield found
    found.stop.close()


@pytest.mark.slow
def test_the_summary_is_computed_outside_of_the_write_transaction(
    bench: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another writer is not kept waiting while the results of a submission are read and averaged."""
    submission = bench.begin("nap", "nap")
    computed: list[bool] = []

    def summarise_and_write(jobs: Sequence[JobRow]) -> SummaryData:
        with bench.store.write() as session:  # would wait in vain for the transaction around it
            computed.append(session.scalar(select(1)) == 1)
        return summarise(jobs)

    monkeypatch.setattr("server.evaluation.summary.summarise", summarise_and_write)
    bench.steps(4)
    assert computed == [True]
    assert read(bench.store, submission).state == SubmissionState.DONE


def test_a_summary_that_a_dead_worker_left_is_written_by_another(bench: Bench, monkeypatch: pytest.MonkeyPatch) -> None:
    submission = bench.begin("nap", "nap")
    with monkeypatch.context() as patch:
        patch.setattr("server.evaluation.dispatcher.write_summary", lambda *_: None)  # as if it died before
        patch.setattr("server.evaluation.dispatcher.write_left_over_summaries", lambda *_: None)
        bench.steps(4)
    assert read(bench.store, submission).state == SubmissionState.RUNNING
    bench.another("two").step(0.0, bench.stop)
    assert read(bench.store, submission).state == SubmissionState.DONE


@pytest.mark.slow
def test_a_submission_that_takes_too_long_ends_within_a_heartbeat(bench: Bench) -> None:
    submission = bench.begin("nap", "nap")
    bench.executor.stuck = {"s0"}
    bench.steps(185, pause_us=20 * S)  # an hour and a little more
    found = read(bench.store, submission)
    assert found.state == SubmissionState.OVER_BUDGET and "make the agent faster" in found.why
    assert bench.executor.ended == ["1.1"] and bench.executor.waiting == {}
