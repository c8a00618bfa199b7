"""`results` and `cancel` against the real server, over HTTP."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest
from click.testing import Result
from testing.api_app import HIDDEN, Server, another_zip, listening
from testing.participant_fakes import Run, command_line
from testing.store_samples import LEASE, NOON, summary

from mdrive_sumo.core.state import FailureReason
from server.enums import ScenarioVerdict
from server.store import jobs, submissions
from server.store.jobs import JobOutcome


@dataclass
class Team:
    """A team's terminal."""

    server: Server
    run: Run
    url: str

    def says(self, *words: object, code: int = 0, who: str = "red") -> str:
        found: Result = self.run(*words, "--server", self.url, "--token", self.server.tokens[who])
        assert found.exit_code == code, found.output
        return found.output


@pytest.fixture
def team(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Team]:
    monkeypatch.chdir(tmp_path)
    for name in ("MDRIVE_SERVER", "MDRIVE_TOKEN"):
        monkeypatch.delenv(name, raising=False)
    server = Server(tmp_path / "data")
    with listening(server) as url:
        yield Team(server, command_line(monkeypatch), url)


def done(team: Team, number: int = 0, **fields: str) -> str:
    """A finished submission: one good scenario and one of a failed agent."""
    mine = team.server.send("red", another_zip(number), **fields).json()["id"]
    outcomes = (
        JobOutcome(ScenarioVerdict.OK, {"ds": 90.25, "sr": 100.0, "rc": 100.0}),
        JobOutcome(ScenarioVerdict.AGENT_FAILED, {"ds": 12.5, "sr": 0.0}, FailureReason.TIMEOUT),
    )
    with team.server.store.write() as session:
        for outcome in outcomes:
            job = jobs.claim(session, "w", LEASE, NOON)
            assert job is not None and jobs.finish(session, job.id, "w", job.attempt, outcome, NOON)
        assert submissions.finish_if_complete(session, mine, summary(51.375), NOON)
    return mine


@pytest.mark.slow
def test_results_are_listed_shown_and_written(team: Team, tmp_path: Path) -> None:
    assert team.says("results") == "No submissions yet. Next: mdrive-sumo submit DIR\n"
    mine = done(team)
    assert [line.split() for line in team.says("results").splitlines()[2:]] == [
        [mine, "dev", "single-agent", "method", "done", "51.38"]
    ]
    said = team.says("results", mine, "--csv", "out.csv")
    lines = said.splitlines()
    assert lines[:2] == ["method in dev, track single-agent: done", "overall: DS 51.38, SR 50.00"]
    assert [line.split() for line in lines[4:6]] == [
        ["merge", "agent-failed", "(timeout)", "12.50", "0.00", "-"], ["left-turn", "ok", "90.25", "100.00", "100.00"],
    ]  # fmt: skip
    assert lines[6:] == [
        "2 of 2 scenarios have a result.", f"page: {team.url}/submissions/{mine}", "scenarios: out.csv",
    ]  # fmt: skip
    rows = list(csv.DictReader((tmp_path / "out.csv").read_text().splitlines()))
    assert [(row["scenario"], row["ds"]) for row in rows] == [("left-turn", "90.25"), ("merge", "12.5")]
    assert "expected a new file" in team.says("results", mine, "--csv", "out.csv", code=2)
    assert team.says("results", f"{team.url}/submissions/{mine}", "--follow").startswith("queued\n")


@pytest.mark.slow
def test_results_of_a_hidden_phase_are_two_rounded_scores(team: Team) -> None:
    mine = done(team, phase=HIDDEN.id)
    said = team.says("results", mine)
    assert "overall: DS 51.40, SR 50.00" in said and "hidden" in said and "left-turn" not in said
    assert "(403)" in team.says("results", mine, "--csv", "out.csv", code=2)


@pytest.mark.slow
def test_a_submission_is_cancelled_after_a_question(team: Team) -> None:
    mine = team.server.send("red").json()["id"]
    assert "Cancel method in dev (queued)? [y/N]" in team.says("cancel", mine, code=1)
    assert team.server.get(f"/submissions/{mine}", "red")["state"] == "queued"
    assert "(404)" in team.says("cancel", mine, "--yes", code=2, who="blue")
    assert team.says("cancel", mine, "--yes") == f"{mine}: cancelled\n"
    assert "(409)" in team.says("cancel", mine, "--yes", code=2)
    assert "cancelled" in team.says("results", mine, code=1)


@pytest.mark.slow
def test_bad_input_is_refused_in_one_sentence(team: Team) -> None:
    for text in ("abc", "0" * 31, "g" * 32, "../" + "0" * 33):
        for command in ("results", "cancel"):
            assert "expected an id of 32 hexadecimal digits" in team.says(command, text, code=2)
    assert "expected --server or MDRIVE_SERVER" in team.run("results").output
    assert "expected --token or MDRIVE_TOKEN" in team.run("results", "--server", team.url).output
    assert "expected the ID" in team.says("results", "--follow", code=2)


def test_help_names_exit_codes_and_quota(monkeypatch: pytest.MonkeyPatch) -> None:
    run = command_line(monkeypatch)
    assert "Exit codes" in run("results", "--help").output and "quota" in run("cancel", "--help").output
