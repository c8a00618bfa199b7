"""Hidden scenarios leak nothing: markers are planted wherever a server knows them, and searched in every answer.

The same search over a public phase with the same markers finds them, so it can find them.
"""

import re
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from testing.api_app import API, HIDDEN, Server, another_zip
from testing.store_samples import LEASE, PHASE, S
from testing.suite_fakes import make_suite

from mdrive_sumo.core.errors import InputError
from server import paths
from server.api.app import prepare_storage
from server.api.schemas.parameters import to_datetime
from server.clock import DAY_US
from server.enums import MIN_HIDDEN_SCENARIOS, ScenarioVerdict
from server.phase_suites import LoadedPhaseSuites
from server.store import jobs, submissions
from server.store.jobs import JobOutcome
from server.store.phases import NewPhase, set_phases

pytestmark = pytest.mark.slow

SCENARIO = "marker-scenario-id"
COORDINATES = ("4711.25", "-815.125")
TIMES = {"started_us": 40_000 * DAY_US, "finished_us": 40_000 * DAY_US + S}
MARKERS = (
    SCENARIO,
    *COORDINATES,
    "marker-bystander",
    "marker-log",
    "marker-recording",
    "marker-replay",
    "marker-failure",
    "suite-marker",
    "marker-why",
    "31.415926",  # seconds that a box took
    "marker-category",
    "marker-bucket",
    "27.182818",  # DS of a single scenario
    *("55.512345", "50.678901", "61.803398", "0.577215", "44.102031", "66.260701", "1.414213"),  # more digits, figures
    "marker-kind",  # of an infraction
    "12:47:1",  # when its submission was finished
    str(to_datetime(TIMES["started_us"]).year),  # when it began and ended
)
RESULT = {
    "ds": 27.182818, "sr": 0.0, "rc": 1.0, "ip": 1.0, "bucket": "marker-bucket", "category": "marker-category",
    "egos": [{
        "id": "cav-1", "outcome": "arrived", "reason": "", "ds": 27.182818, "rc": 1.0, "ip": 1.0,
        "infractions": [{"kind": "collision", "tick": 7, "x": 4711.25, "y": -815.125, "factor": 0.6,
                         "other": "marker-bystander"}],
    }],
}  # fmt: skip
ONE_SCENARIO = {"ds": 27.182818, "sr": 0.0, "scenarios": 1}
SUMMARY: Any = {
    "sensing_track": "object",
    "results_sha256": "0" * 64,
    "overall": {
        "ds": 55.512345,
        "sr": 50.678901,
        "rc": 61.803398,
        "ip": 0.577215,
        "ds_low": 44.102031,
        "ds_high": 66.260701,
        "scenarios": 20,
        "infractions": {"marker-kind": 1},
        "slowest": SCENARIO,
        "time_ratio": 1.414213,
        "timed": 9,
    },
    "buckets": {
        "marker-bucket": ONE_SCENARIO,
        "few": {"ds": 1.0, "scenarios": 4, "time_ratio": 1.5, "timed": 1},
        "interaction": {"ds": 56.0, "scenarios": 15, "time_ratio": 2.5, "timed": 8},
    },
    "categories": {"marker-category": ONE_SCENARIO},
}


class Phase:
    """A phase with submissions of red in every state, full of markers."""

    def __init__(self, server: Server, phase: NewPhase) -> None:
        self.server, self.phase = server, phase.id
        with server.store.write() as session:
            set_phases(session, [replace(phase, per_day=50, in_parallel=50, suite="/srv/suite-marker")], 0)
        self.ids = [self._done(), self._rejected(), self._failed(), self._running()]

    def _sent(self, number: int) -> str:
        self.server.now_us += S
        return self.server.send(data=another_zip(number), phase=self.phase).json()["id"]

    def _done(self) -> str:
        mine = self._sent(1)
        with self.server.store.write() as session:
            while (job := jobs.claim(session, "w", LEASE, TIMES["started_us"])) is not None:
                outcome = JobOutcome(ScenarioVerdict.OK, RESULT, usage={"cpu_s": 31.415926})
                assert jobs.finish(session, job.id, "w", job.attempt, outcome, TIMES["finished_us"])
            finished_us = self.server.now_us + (47 * 60 + 10) * S
            assert submissions.finish_if_complete(session, mine, SUMMARY, finished_us)
            submissions.add_event(session, mine, "scenario", {"scenario": SCENARIO}, self.server.now_us)  # by mistake
        place = (self.server.settings, mine, SCENARIO, 0)
        paths.recordings_folder(self.server.settings, mine, 0).mkdir(parents=True)
        paths.recording_path(*place).write_text("marker-recording")
        paths.replay_path(*place).write_text("marker-replay")
        paths.log_path(*place, "cav-1").write_text("marker-log")
        return mine

    def _rejected(self) -> str:
        """An agent can say in what it asks for what it has seen."""
        mine = self._sent(2)
        with self.server.store.write() as session:
            submissions.reject(session, mine, f"sensor 'marker-why {SCENARIO} 4711.25': expected one of lidar", S)
        return mine

    def _failed(self) -> str:
        mine = self._sent(3)
        with self.server.store.write() as session:
            for _ in range(jobs.MAX_FAILURES):
                job = jobs.claim(session, "w", LEASE, TIMES["started_us"])
                assert job is not None
                jobs.record_failure(session, job.id, "w", job.attempt, f"marker-failure in {SCENARIO}", S)
        return mine

    def _running(self) -> str:
        mine = self._sent(4)
        with self.server.store.write() as session:
            job = jobs.claim(session, "w", LEASE, TIMES["started_us"])
            assert job is not None
            outcome = JobOutcome(ScenarioVerdict.OK, RESULT, usage={"cpu_s": 31.415926})
            jobs.finish(session, job.id, "w", job.attempt, outcome, TIMES["finished_us"])
        return mine

    def answers(self) -> Iterator[tuple[str, str]]:
        """Every GET of the description, for every caller but admins, with all that could be asked for."""
        for template, methods in self.server.app.openapi()["paths"].items():
            if "get" not in methods:
                continue
            for path in self._paths(template.removeprefix(API)):
                for who in ("", "red", "blue"):
                    answer = self.server.ask("GET", path, who)
                    told = " ".join(f"{name}: {value}" for name, value in answer.headers.items())
                    yield f"{who} GET {path}", f"{told} {answer.text}"

    def _paths(self, template: str) -> Iterator[str]:
        template = template.replace("{phase}", self.phase).replace("{team}", "red").replace("{name}", "red")
        template = template.replace("{token}", "0" * 32)
        ids = self.ids if "{submission}" in template else [""]
        for each in ids:
            # A stream of events goes on until its submission is finished.
            if template.endswith("/events") and each == self.ids[3]:
                continue
            path = template.replace("{submission}", each).replace("{scenario}", SCENARIO).replace("{seed}", "0")
            path = path.replace("{cav}", "cav-1").replace(
                "{other}", self.ids[0] if each != self.ids[0] else self.ids[3]
            )
            yield f"{path}?q=method" if path == "/search" else path
            if path.startswith("/leaderboards") and "teams" not in path:
                yield f"{path}?bucket=interaction"
                for part in ("bucket=marker-bucket", "category=marker-category"):
                    yield f"{path}?{part}"

    def found(self) -> set[tuple[str, str]]:
        """See `find_markers`."""
        return find_markers(self.answers())


def find_markers(answers: Iterable[tuple[str, str]]) -> set[tuple[str, str]]:
    """Marker, and where it stands. What was asked for is repeated in an answer; that is no leak."""
    hits: set[tuple[str, str]] = set()
    for asked, text in answers:
        said = {marker for marker in MARKERS if marker in asked}
        hits |= {(marker, asked) for marker in MARKERS if marker not in said and marker in text}
        if '"rows":[{' in text and said:
            hits |= {(marker, asked) for marker in said}
    return hits


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Server:
    found = Server(tmp_path)
    monkeypatch.setattr("testing.api_app.FakeSuites.jobs", lambda *_: [(SCENARIO, 0), ("other-hidden-one", 0)])
    return found


def test_hidden_phases_leak_nothing(server: Server) -> None:
    answers = list(Phase(server, HIDDEN).answers())
    assert not find_markers(answers)
    assert not any("other-hidden-one" in text for _, text in answers)


def test_the_search_finds_what_is_there(server: Server) -> None:
    missed = set(MARKERS) - {marker for marker, _ in Phase(server, PHASE).found()}
    assert missed == {"marker-failure", str(to_datetime(TIMES["started_us"]).year)}, (
        "only admins are told of our failures"
    )


def test_the_rounded_score_is_shown_and_nothing_else(server: Server) -> None:
    done, rejected, _, _ = Phase(server, HIDDEN).ids
    figures = {"ds": 55.5, "sr": 51.0, "scenarios": 20}
    for who in ("", "red", "blue"):
        shown = server.get(f"/submissions/{done}", who)
        assert {name: value for name, value in shown["summary"]["overall"].items() if value is not None} == figures
        assert shown["summary"]["buckets"] == {} == shown["summary"]["categories"]
        assert shown["finished"].endswith("T12:00:00Z")
    row = server.get(f"/leaderboards/{HIDDEN.id}")["rows"][0]
    assert {name: value for name, value in row["figures"].items() if value is not None} == figures
    assert server.get(f"/leaderboards/{HIDDEN.id}/teams/red")["items"][0]["ds"] == 55.5
    assert server.get(f"/leaderboards/{HIDDEN.id}?bucket=interaction")["rows"] == []
    assert "in a public phase" in server.get(f"/submissions/{rejected}", "red")["why"]


def test_admins_see_the_exact_result(server: Server) -> None:
    done = Phase(server, HIDDEN).ids[0]
    shown = server.get(f"/submissions/{done}", "admin")
    assert shown["summary"]["overall"]["ds"] == 55.512345
    assert "interaction" in shown["summary"]["buckets"] and "T12:47:1" in shown["finished"]


def test_too_few_scenarios_cannot_be_hidden(server: Server, tmp_path: Path) -> None:
    """Neither when the server starts nor, where the phase came later, with an upload."""
    server.app.state.services = replace(server.app.state.services, suites=LoadedPhaseSuites(server.settings))
    few, enough = (
        make_suite(tmp_path / str(size), *["drive"] * size) for size in (MIN_HIDDEN_SCENARIOS - 1, MIN_HIDDEN_SCENARIOS)
    )
    for suite, status in ((few, 422), (enough, 201)):
        with server.store.write() as session:
            set_phases(session, [replace(HIDDEN, suite=str(suite.folder))], 0)
        with pytest.raises(InputError, match=r"expected at least 5.*found 4") if status == 422 else nullcontext():
            prepare_storage(server.app.state.services, server.now_us)
        answer = server.send(phase=HIDDEN.id)
        assert answer.status_code == status and ("expected at least 5 hidden" in answer.text) is (status == 422)


def test_nothing_of_a_hidden_phase_tells_when_its_scenarios_end(server: Server) -> None:
    """No counts, no estimate, no event while it runs; and none of a public submission that waits behind it."""
    running = Phase(server, HIDDEN).ids[3]
    shown = server.get(f"/submissions/{running}", "red")
    assert (shown["state"], shown["progress"], shown["queue"]) == ("running", None, {"position": 1, "eta_s": None})
    server.now_us += S
    behind = server.send("blue").json()
    assert behind["queue"] == {"position": 2, "eta_s": None}
    with server.store.write() as session:
        submissions.cancel(session, running, server.now_us)
    told = server.ask("GET", f"/submissions/{running}/events", "red").text
    assert re.findall(r"event: (\w+)\ndata: (.*)", told) == [
        ("state", '{"state":"queued"}'), ("state", '{"state":"running"}'), ("state", '{"state":"cancelled"}'),
    ]  # fmt: skip
    assert server.get(f"/submissions/{behind['id']}", "blue")["queue"]["eta_s"] is not None
    assert server.ask("GET", "/metrics", "red").status_code == 403
