"""Large results: lists read none of them, their overviews are bounded, and the health check answers meanwhile."""

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from typing import Any

import httpx
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sqlalchemy import event, insert
from testing.api_app import API, Server, listening
from testing.store_samples import LEASE, NOON, S, summary

from server.enums import JobState, ScenarioVerdict
from server.store import jobs, overviews, retention, submissions, tables
from server.store.jobs import JobOutcome
from server.store.retention import RetentionPolicy

DAY_US = 86_400_000_000


def ego(name: str, infractions: int) -> dict[str, Any]:
    found = {"kind": "collision-vehicle", "tick": 7, "x": 1.5, "y": 2.5, "factor": 0.6, "other": "bg-3"}
    return {
        "id": name, "outcome": "arrived", "reason": "", "ds": 20.0, "rc": 20.0, "ip": 1.0, "ticks": 3,
        "infractions": [found] * infractions,
    }  # fmt: skip


def result(egos: int, infractions: int, notes: int = 0) -> dict[str, Any]:
    scores = {"ds": 20.0, "sr": 0.0, "rc": 20.0, "ip": 1.0, "bucket": "interdrive", "category": "merge"}
    return scores | {
        "egos": [ego(f"cav-{n}", infractions) for n in range(egos)],
        "notes": {f"n{n}": 1 for n in range(notes)},
    }


def finish_all(server: Server, outcome: JobOutcome) -> str:
    mine = server.send().json()["id"]
    with server.store.write() as session:
        while (job := jobs.claim(session, "w", LEASE, server.now_us)) is not None:
            assert jobs.finish(session, job.id, "w", job.attempt, outcome, server.now_us + S)
        assert submissions.finish_if_complete(session, mine, summary(20.0), server.now_us + S)
    return mine


@contextmanager
def statements(server: Server) -> Iterator[list[str]]:
    """The SQL that is run."""
    found: list[str] = []

    def note(_connection: object, _cursor: object, statement: str, *_: object) -> None:
        found.append(statement)

    event.listen(server.store.engine, "before_cursor_execute", note)
    try:
        yield found
    finally:
        event.remove(server.store.engine, "before_cursor_execute", note)


@pytest.mark.slow
def test_no_list_reads_results(server: Server) -> None:
    server.mount_pages()
    mine = finish_all(server, JobOutcome(ScenarioVerdict.OK, result(2, 1), usage={"cpu_s": 1.0}))
    for who in ("", "red", "admin"):
        headers = {"Authorization": f"Bearer {server.tokens[who]}"} if who else {}
        with statements(server) as run:
            for path in (
                *(f"{API}/submissions/{mine}{more}" for more in ("", "/scenarios")),
                *(f"/submissions/{mine}{more}" for more in ("", "/progress", "/scenarios/merge/0")),
                f"{API}/leaderboards/dev",
                *([f"{API}/submissions"] if who else []),
            ):
                answer = server.client.get(path, headers=headers)
                assert answer.status_code == 200, (path, answer.text)
        assert run and not [one for one in run if "jobs.result" in one or "jobs.usage" in one]


@given(st.integers(1, 8), st.integers(0, 300), st.integers(0, 60_000))
def test_overviews_are_bounded(egos: int, infractions: int, usage: int) -> None:
    found = overviews.make_overview(result(egos, infractions), {"text": "x" * usage})
    assert overviews.count_bytes(found) <= overviews.MAX_BYTES
    assert len(found["egos"]) == egos and found["ds"] == 20.0
    for each in found["egos"]:
        assert len(each["infractions"]) + each.get("infractions_left_out", 0) == infractions
    assert (found["usage"] is None) <= (usage > 4000)


def test_what_is_left_out_is_said(server: Server) -> None:
    mine = finish_all(server, JobOutcome(ScenarioVerdict.OK, result(1, 50)))
    (each,) = server.get(f"/submissions/{mine}/scenarios")["items"][0]["egos"]
    assert (len(each["infractions"]), each["infractions_left_out"]) == (10, 40)


def test_results_of_old_submissions_are_deleted_their_summary_stays(server: Server) -> None:
    """What stands on a leaderboard keeps everything."""
    best = finish_all(server, JobOutcome(ScenarioVerdict.OK, result(1, 1), usage={"cpu_s": 1.0}))
    old = server.send("blue").json()["id"]
    with server.store.write() as session:
        job = jobs.claim(session, "w", LEASE, NOON)
        assert job is not None and jobs.finish(
            session, job.id, "w", 1, JobOutcome(ScenarioVerdict.OK, result(1, 1)), NOON
        )
        submissions.cancel(session, old, NOON)
    policy = RetentionPolicy(result_days=10)
    assert retention.delete_expired_rows(server.store, policy, NOON + 9 * DAY_US) == 0
    assert retention.delete_expired_rows(server.store, policy, NOON + 11 * DAY_US) == 1
    assert retention.delete_expired_rows(server.store, policy, NOON + 11 * DAY_US) == 0
    with server.store.read() as session:
        kept = session.query(tables.JobRow).filter(tables.JobRow.result.is_not(None)).all()
        assert {job.submission for job in kept} == {best}
        for table in (tables.JobOverviewRow, tables.EventRow):
            assert {row.submission for row in session.query(table)} == {best}
    assert server.get(f"/submissions/{old}", "blue")["state"] == "cancelled"
    assert [row["ds"] for row in server.get(f"/submissions/{old}/scenarios", "blue")["items"]] == [None, None]


@pytest.mark.slow
def test_health_answers_while_lists_are_read(server: Server) -> None:
    """As found: 225 scenarios with large overviews, twelve anonymous clients without a pause."""
    mine = finish_all(server, JobOutcome(ScenarioVerdict.OK, result(8, 6)))
    large = overviews.make_overview(result(8, 6), {"text": "x" * 1000})
    with server.store.write() as session:
        for number in range(223):
            own = {"submission": mine, "others": mine, "scenario": f"s{number:03}", "seed": 0}
            row = tables.JobRow(**own, state=JobState.DONE.value, verdict="ok")
            session.add(row)
            session.flush()
            session.execute(insert(tables.JobOverviewRow).values(job=row.id, submission=mine, data=large))
    with listening(server) as address, ThreadPoolExecutor(12) as pool, httpx.Client(timeout=60) as client:
        end_s = time.process_time() + 1.5

        def read() -> int:
            count = 0
            while time.process_time() < end_s:
                assert client.get(f"{address}{API}/submissions/{mine}/scenarios").status_code == 200
                count += 1
            return count

        readers = [pool.submit(read) for _ in range(12)]
        took_s: list[float] = []
        while time.process_time() < end_s:
            since_s = time.process_time()
            assert client.get(f"{address}{API}/health").status_code == 200
            took_s.append(time.process_time() - since_s)
            time.sleep(0.05)
        assert sum(each.result() for each in readers) >= 12
    # 19 s as found; clients and server share an interpreter here, whose time other work on the machine does not take
    assert max(took_s) < 3.0, took_s
