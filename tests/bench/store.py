"""How long the database takes with 10 000 submissions stored: `python tests/bench/store.py [sqlite|postgresql]`.

Leaderboards (overall, by bucket, by category), a history, a claim and a finish, each called many times; prints the
median and the 99th percentile of the wall time, and the mean CPU time of this process, which says more where the
machine is busy. SQLite is a file in the temporary folder, PostgreSQL one started here.
"""

import random
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

sys.path[:0] = [str(Path(__file__).parents[2]), str(Path(__file__).parents[1])]

from sqlalchemy import insert  # noqa: E402
from testing import databases  # noqa: E402
from testing.store_samples import GOOD, LEASE, NEW, NOON, PHASE, with_teams  # noqa: E402

from server.enums import ChallengeTrack, SubmissionState  # noqa: E402
from server.store import Store, jobs, queries, standings, submissions  # noqa: E402
from server.store.tables import JobRow, SubmissionRow  # noqa: E402

SUBMISSIONS, TEAMS, CALLS, QUEUED = 10_000, 200, 300, 20
BUCKETS = ("InterDrive", "Interaction", "V2XPnP")
CATEGORIES = tuple(f"category-{number}" for number in range(20))


def filled(store: Store, teams: list[str], draw: random.Random, queued: int = QUEUED) -> None:
    """All in one phase; half of them in one track, and the last ones still queued with 225 jobs each."""
    tracks = (ChallengeTrack.SINGLE, ChallengeTrack.SINGLE, ChallengeTrack.SHARING, ChallengeTrack.NEGOTIATION)
    done = SUBMISSIONS - queued
    rows = [submission(n, draw.choice(teams), draw.choice(tracks), draw, n < done) for n in range(SUBMISSIONS)]
    waiting = [row["id"] for row in rows if row["state"] == SubmissionState.QUEUED]
    with store.write() as session:
        session.execute(insert(SubmissionRow), rows)
        waiting_jobs = [
            {"submission": id_, "others": id_, "scenario": f"s{n}", "seed": 0, "state": "queued"}
            for id_ in waiting
            for n in range(225)
        ]
        if waiting_jobs:
            session.execute(insert(JobRow), waiting_jobs)
        last = {(row["team"], row["track"]): row["id"] for row in rows}
        for id_ in last.values():
            standings.update_standings(session, submissions.get(session, id_))


def submission(number: int, team: str, track: ChallengeTrack, draw: random.Random, done: bool) -> dict[str, Any]:
    """One row."""
    names = {"buckets": BUCKETS, "categories": CATEGORIES}
    summary: dict[str, Any] = {group: {name: figures(draw) for name in of} for group, of in names.items()}
    summary |= {"overall": figures(draw), "sensing_track": ""}
    return {
        "id": f"{number:032x}",
        "team": team,
        "phase": PHASE.id,
        "track": track.value,
        "name": "method",
        "archive_sha256": f"{number:064x}",
        "archive_bytes": 1,
        "environment": NEW.environment,
        "evaluator": NEW.evaluator,
        "state": SubmissionState.DONE.value if done else SubmissionState.QUEUED.value,
        "created_us": NOON + number,
        "summary": summary if done else None,
        "ds": summary["overall"]["ds"] if done else None,
    }


def figures(draw: random.Random) -> dict[str, float]:
    """With confidence intervals."""
    ds = round(draw.uniform(0, 100), 6)
    return {"ds": ds, "sr": 50.0, "ds_low": ds - 1, "ds_high": ds + 1, "sr_low": 49.0, "sr_high": 51.0}


def timed(name: str, deed: Callable[[], object]) -> None:
    """Calls it and prints how long it takes."""
    took: list[float] = []
    processor = time.process_time()
    for _ in range(CALLS):
        begun = time.perf_counter()
        deed()
        took.append((time.perf_counter() - begun) * 1e3)
    own = (time.process_time() - processor) / CALLS * 1e3
    took.sort()
    print(f"{name:24} median {took[CALLS // 2]:7.2f} ms   p99 {took[CALLS * 99 // 100]:7.2f} ms   CPU {own:6.2f} ms")  # noqa: T201


def main() -> None:
    """On the database named by the first argument."""
    backend, draw = (sys.argv[1:] or ["sqlite"])[0], random.Random(0)
    with tempfile.TemporaryDirectory() as folder:
        store = databases.opened(backend, Path(folder))
        teams = with_teams(store, *(f"team {number}" for number in range(TEAMS)))
        begun = time.perf_counter()
        filled(store, teams, draw)
        if backend == "postgresql":
            with store.engine.execution_options(isolation_level="AUTOCOMMIT").connect() as connection:
                connection.exec_driver_sql("VACUUM ANALYZE")
        print(f"{backend}: {SUBMISSIONS} submissions of {TEAMS} teams in {time.perf_counter() - begun:.0f} s")  # noqa: T201

        def board(track: ChallengeTrack | None, **which: str) -> Callable[[], object]:
            def ask() -> None:
                with store.read() as session:
                    assert queries.find_leaderboard(session, PHASE.id, track, **which)

            return ask

        def claim_and_finish() -> None:
            with store.write() as session:
                job = jobs.claim(session, "w", LEASE, NOON)
            assert job is not None
            with store.write() as session:
                assert jobs.finish(session, job.id, "w", job.attempt, GOOD, NOON)

        def history() -> None:
            with store.read() as session:
                queries.list_history(session, draw.choice(teams), PHASE.id)

        timed("one track", board(ChallengeTrack.SINGLE))
        timed("all tracks", board(None))
        timed("all tracks, one bucket", board(None, bucket="Interaction"))
        timed("one track, one category", board(ChallengeTrack.SINGLE, category="category-3"))
        timed("history of a team", history)
        timed("claim and finish", claim_and_finish)
        store.close()


if __name__ == "__main__":
    main()
