"""Comparison, search, matrix and CSV: their numbers, and that they show to whom what the single pages show."""

import csv
import io
from pathlib import Path
from statistics import fmean
from typing import Any

import pytest
from testing import databases
from testing.api_app import HIDDEN, Server, another_zip, problem
from testing.store_samples import LEASE, S, summary
from testing.web_page import Visit

from server.api.csv_format import to_csv
from server.enums import ScenarioVerdict
from server.store import jobs, submissions
from server.store.jobs import JobOutcome

pytestmark = pytest.mark.slow

WHO = ("", "blue", "red", "worker", "admin")
SCENARIOS = [(name, seed) for name in ("a", "b", "c") for seed in (0, 1)]


@pytest.fixture
def server(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Server:
    monkeypatch.setattr("testing.api_app.FakeSuites.jobs", lambda *_: SCENARIOS)
    return Server(tmp_path)


def done(server: Server, who: str, scores: list[float], failed: int = 0, **fields: str) -> str:
    """A finished submission with these DS in the order of `SCENARIOS`; the first `failed` ones with a failed agent."""
    server.now_us += S
    mine = server.send(who, another_zip(server.now_us // S), **fields).json()["id"]
    with server.store.write() as session:
        for _ in SCENARIOS:
            job = jobs.claim(session, "w", LEASE, server.now_us)
            assert job is not None and job.submission == mine
            place = SCENARIOS.index((job.scenario, job.seed))
            verdict = ScenarioVerdict.AGENT_FAILED if place < failed else ScenarioVerdict.OK
            result = {"ds": scores[place], "sr": 0.0, "bucket": "=B", "category": "merge", "egos": []}
            assert jobs.finish(session, job.id, "w", job.attempt, JobOutcome(verdict, result), server.now_us)
        assert submissions.finish_if_complete(session, mine, summary(fmean(scores)), server.now_us)
    return mine


def test_a_comparison_pairs_scenarios(server: Server) -> None:
    a, b = done(server, "red", [10, 20, 30, 40, 50, 60]), done(server, "blue", [20, 30, 30, 40, 0, 60.001])
    found = server.get(f"/submissions/{a}/compare/{b}")
    assert (found["a"]["id"], found["b"]["id"], found["same_evaluator"]) == (a, b, True)
    assert [(row["scenario"], row["seed"], row["ds_difference"]) for row in found["scenarios"]] == [
        ("c", 0, -50.0), ("b", 0, 0.0), ("b", 1, 0.0), ("c", 1, pytest.approx(0.001)), ("a", 0, 10.0), ("a", 1, 10.0),
    ]  # fmt: skip
    paired = found["paired"]
    assert (paired["scenarios"], paired["better"], paired["equal"], paired["worse"]) == (3, 1, 1, 1)
    assert paired["ds"] == pytest.approx((10 + 0 - 24.9995) / 3)
    assert paired["ds_low"] is paired["ds_high"] is None, "three scenarios are too few"
    page = Visit(server).get(f"/submissions/{a}/compare?other={b}")
    assert "3 scenarios that both have: too few for an interval" in page.words
    back = server.get(f"/submissions/{b}/compare/{a}")["paired"]
    assert (back["ds"], back["better"], back["worse"]) == (pytest.approx(-paired["ds"]), 1, 1)
    assert server.get(f"/submissions/{a}/compare/{b}", "red")["a"]["archive_sha256"], "each as its own page shows it"
    assert server.get(f"/submissions/{a}/compare/{b}", "red")["b"]["archive_sha256"] is None


def test_a_comparison_needs_two_that_can_be_compared(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    a, hidden = done(server, "red", [1] * 6), done(server, "red", [1] * 6, phase=HIDDEN.id)
    problem(server.ask("GET", f"/submissions/{a}/compare/{a}"), 422, "found the same twice")
    problem(server.ask("GET", f"/submissions/{a}/compare/{hidden}"), 422, "found dev and test")
    problem(server.ask("GET", f"/submissions/{a}/compare/{'0' * 32}"), 404, "there is no")
    monkeypatch.setattr("testing.api_app.FakeSuites.evaluator", lambda *_: {"version": "2"})
    assert server.get(f"/submissions/{a}/compare/{done(server, 'red', [2] * 6)}")["same_evaluator"] is False


def test_a_comparison_of_a_hidden_phase_has_the_rounded_scores_only(server: Server) -> None:
    a, b = (done(server, "red", [ds] * 6, phase=HIDDEN.id) for ds in (40.123, 40.456))
    for who in ("", "blue", "red"):
        found = server.get(f"/submissions/{a}/compare/{b}", who)
        assert found["scenarios"] is None and found["paired"] is None
        assert [found[side]["summary"]["overall"]["ds"] for side in "ab"] == [40.1, 40.5]
    assert len(server.get(f"/submissions/{a}/compare/{b}", "admin")["scenarios"]) == 6


def test_results_as_csv(server: Server) -> None:
    mine = done(server, "red", [10.5, 20, 30, 40, 50, 60], failed=1)
    answer = server.ask("GET", f"/submissions/{mine}/scenarios.csv")
    assert answer.headers["content-type"] == "text/csv; charset=utf-8" and mine in answer.headers["content-disposition"]
    rows = list(csv.DictReader(io.StringIO(answer.text)))
    told = server.get(f"/submissions/{mine}/scenarios")["items"]
    for name in ("scenario", "seed", "verdict", "ds", "category"):
        assert [row[name] for row in rows] == [str(each[name]) for each in told]
    assert rows[0]["verdict"] == "agent-failed" and rows[0]["bucket"] == "'=B" and rows[0]["rc"] == ""
    hidden = done(server, "red", [1] * 6, phase=HIDDEN.id)
    for who in ("", "blue", "red"):
        assert problem(server.ask("GET", f"/submissions/{hidden}/scenarios.csv", who), 403)["type"].endswith("hidden")
    assert server.ask("GET", f"/submissions/{hidden}/scenarios.csv", "admin").status_code == 200


@pytest.mark.parametrize("cell", ["=1+1", "+a", "-a", "@a", "\t=1"])
def test_no_cell_is_a_formula(cell: str) -> None:
    ((name,), (value,)) = csv.reader(io.StringIO(to_csv([cell], [[cell]]), newline=""))
    assert name == value == f"'{cell}"


@pytest.mark.parametrize("backend", databases.BACKENDS)
def test_the_matrix(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, backend: str) -> None:
    monkeypatch.setattr("testing.api_app.FakeSuites.jobs", lambda *_: SCENARIOS)
    server = Server(tmp_path, databases.emptied(backend))
    done(server, "red", [0] * 6)
    best, blue = done(server, "red", [80, 100, 60, 60, 40, 40], failed=1), done(server, "blue", [50] * 6)
    found = server.get("/phases/dev/matrix", "admin")
    assert [(each["team"], each["submission"], each["rank"]) for each in found["columns"]] == [
        ("red", best, 1), ("blue", blue, 2),
    ]  # fmt: skip
    assert [(row["scenario"], row["bucket"], row["ds"], row["failed"]) for row in found["rows"]] == [
        ("a", "=B", 70.0, 1), ("b", "=B", 55.0, 0), ("c", "=B", 45.0, 0),
    ]  # fmt: skip
    assert found["rows"][0]["cells"] == [{"ds": 90.0, "failed": 1}, {"ds": 50.0, "failed": 0}]
    assert server.get("/phases/dev/matrix?track=joint", "admin")["rows"] == []
    monkeypatch.setattr("server.api.matrix.TEAMS_PER_PAGE", 1)
    second = server.get("/phases/dev/matrix?page=9", "admin")
    assert (second["page"], second["pages"], second["columns"][0]["team"]) == (2, 2, "blue")
    problem(server.ask("GET", "/phases/nope/matrix", "admin"), 404, "expected one of")


def test_a_search_finds_what_the_caller_may_see(server: Server) -> None:
    """Exactly the submissions that `GET /submissions/{id}` shows; teams by their names on them."""
    shown, kept = done(server, "red", [1] * 6, name="50% Planner"), done(server, "red", [2] * 6, name="planner two")
    server.ask("PUT", f"/submissions/{kept}/shown", "red", json={"shown": False})
    hidden = done(server, "red", [3] * 6, name="Planner hidden", phase=HIDDEN.id)
    server.now_us += S
    waiting = server.send("blue", another_zip(99), name="planner of blue").json()["id"]
    ids = (shown, kept, hidden, waiting)
    for who in WHO:
        found = server.get("/search?q=PLANNER", who)
        visible = {each for each in ids if server.ask("GET", f"/submissions/{each}", who).status_code == 200}
        assert {each["id"] for each in found["submissions"]} == visible, who
        for each in found["submissions"]:
            assert each == server.get(f"/submissions/{each['id']}", who)
        names = {each["name"] for text in ("re", "lu") for each in server.get(f"/search?q={text}", who)["teams"]}
        assert names == {"red"} | ({"blue"} if who in ("blue", "admin") else set()), "blue is on no leaderboard"
    assert [each["id"] for each in server.get("/search?q=50%25")["submissions"]] == [shown], "no wildcard"
    assert server.get("/search?q=%25%25")["submissions"] == server.get("/search?q=__")["submissions"] == []
    assert [each["id"] for each in server.get(f"/search?q={shown}")["submissions"]] == [shown]
    server.ask("PUT", "/teams/red/hidden", "admin", json={"hidden": True})
    assert server.get("/search?q=planner") == {"teams": [], "submissions": [], "more": False}
    assert server.get("/search?q=red")["teams"] == [] != server.get("/search?q=red", "red")["teams"]


def test_a_search_is_bounded(server: Server, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("server.api.routes.overviews.MAX_FOUND", 1)
    last: Any = [done(server, "red", [1] * 6) for _ in range(2)][-1]
    found = server.get("/search?q=method")
    assert ([each["id"] for each in found["submissions"]], found["more"]) == ([last], True)
    for text in ("", "a", "a" * 81, "a%00b"):
        problem(server.ask("GET", f"/search?q={text}"), 422, "q")
