"""Submissions in every state, for the tests of the pages. No tests in here."""

from typing import Any

from mdrive_sumo.core.state import FailureReason
from server import paths
from server.enums import ScenarioVerdict
from server.store import jobs, submissions
from server.store.standings import SummaryData
from testing.api_app import Server
from testing.store_samples import LEASE, NOON, S

LATENCY = {"ends_ms": [1, 2, 5], "counts": [4, 10, 3, 1]}
USAGE = {
    "latency": LATENCY,
    "latency_p99_ms": 7.5,
    "peak_memory_bytes": 64_000_000,
    "cpu_s": 12.5,
    "backend": "gvisor",
    "boxes": {},
}
FIGURES: dict[str, Any] = {
    "ds": 71.25, "sr": 50.0, "rc": 90.5, "ip": 0.8, "ds_low": 60.5, "ds_high": 80.5, "sr_low": 20.0, "sr_high": 90.0,
    "scenarios": 12, "infractions": {"collision-vehicle": 1},
}  # fmt: skip
SUMMARY: SummaryData = {
    "overall": FIGURES,
    "buckets": {"Junctions": FIGURES | {"ds": 44.5}},
    "categories": {"crossing": FIGURES | {"ds": 33.5}},
    "sensing_track": "object",
    "results_sha256": "0" * 64,
}


def ego(name: str, outcome: str = "arrived") -> dict[str, Any]:
    """One car's result."""
    hit = {"kind": "collision-vehicle", "tick": 40, "x": 0.0, "y": 0.0, "factor": 0.6, "other": "7"}
    return {"id": name, "outcome": outcome, "ds": 60.0, "rc": 100.0, "ip": 0.6, "infractions": [hit]}


def result(ds: float, outcome: str = "arrived") -> dict[str, Any]:
    """One scenario's."""
    return {"ds": ds, "sr": 50.0, "rc": 90.0, "ip": 0.7, "bucket": "Junctions", "category": "crossing",
            "egos": [ego("0", outcome)]}  # fmt: skip


def sent(server: Server, who: str = "red", **fields: Any) -> str:
    """A new submission's id."""
    return server.send(who, **fields).json()["id"]


def drive(server: Server, number: int = 1, failed: bool = False) -> None:
    """Finishes the next jobs; nothing else may be queued."""
    with server.store.write() as session:
        for _ in range(number):
            job = jobs.claim(session, "host.1.abc", LEASE, NOON)
            assert job is not None
            verdict, reason = (
                (ScenarioVerdict.AGENT_FAILED, FailureReason.TIMEOUT) if failed else (ScenarioVerdict.OK, None)
            )
            outcome = jobs.JobOutcome(verdict, result(20.0 if failed else 80.0), reason, USAGE)
            assert jobs.finish(session, job.id, "host.1.abc", job.attempt, outcome, NOON + S)


def finish(server: Server, submission: str) -> None:
    """Drives what is left of it."""
    drive(server)
    drive(server, failed=True)
    with server.store.write() as session:
        assert submissions.finish_if_complete(session, submission, SUMMARY, NOON + 2 * S)


def files(server: Server, submission: str, scenario: str = "left-turn", text: str = "a log") -> None:
    """A recording, its replay and a log, as a worker leaves them."""
    place = (server.settings, submission, scenario, 0)
    paths.recording_path(*place).parent.mkdir(parents=True, exist_ok=True)
    paths.recording_path(*place).write_bytes(b"recorded")
    paths.replay_path(*place).write_text("<p>replayed</p>")
    paths.log_path(*place, "0").write_text(text)
