"""`study paper` from the command to its files, interrupted and repeated studies, bad input."""

import csv
import json
import re
from pathlib import Path

import pytest
from click.testing import Result
from testing import paper_fakes
from testing.human_study import make_plan
from testing.study_samples import invoke

from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.learning.fusion.detector_tables import DetectorSummary, write_detectors_json
from mdrive_sumo.learning.fusion.detectors_file import COMPARED
from mdrive_sumo.open_loop import OpenLoopScenario
from mdrive_sumo.open_loop.open_loop_job import OpenLoopJob
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.study.human.human_report import NO_PERSON
from mdrive_sumo.study.human.human_study_folder import HumanStudyFolder

AGENTS = "stationary,idm,sharing,constant-speed"


@pytest.fixture
def suite(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    paper_fakes.install(monkeypatch)
    return paper_fakes.make_suite(tmp_path / "suite", "answer", "answer")


def study(suite: Path, *more: str | Path, agents: str = AGENTS, out: str = "out") -> Result:
    folder = suite.parent / out
    return invoke("study", "paper", "--suite", suite, "--agents", agents, "--out", folder, "--workers", "1", *more)


def called(suite: Path, name: str = "calls") -> list[str]:
    return (suite / name).read_text().splitlines() if (suite / name).exists() else []


@pytest.mark.slow
def test_one_command_writes_everything_and_a_second_one_drives_nothing(suite: Path) -> None:
    ended = study(suite)
    assert ended.exit_code == 0, ended.output
    drivers = [call.split()[0] for call in called(suite)]
    assert {name: drivers.count(name) for name in set(drivers)} == {
        "stationary": 6, "sharing": 6, "constant-speed": 6, "idm": 2, "omniscient": 2,
    }  # fmt: skip  # who talks is driven over two worse channels as well; the reference once
    assert len(called(suite, "shown")) == 4 * 2, "every agent sees both recordings"
    out = suite.parent / "out"
    assert {path.name for path in out.iterdir()} == {
        "csv", "latex", "figures", "runs", "paper.html", "paper.md", "paper.json", "study_plan.json",
    }  # fmt: skip
    page = json.loads((out / "paper.json").read_text())
    assert page["plan"] == {part: ["s0", "s1"] for part in ("closed", "logs", "channel")}
    assert page["closed"]["sharing"]["role"] == "multi-agent" and page["closed"]["idm"]["role"] == "single-agent"
    latency = list(csv.DictReader((out / "csv" / "latency.csv").read_text().splitlines()))
    assert [row["agent"] for row in latency] == ["stationary", "sharing", "constant-speed"], (
        "no scenario is the paper's"
    )
    assert (latency[0]["ds_clean"], latency[0]["ds_perturbed"], latency[0]["ds_difference"]) == ("70", "64", "-6")
    rho = list(csv.DictReader((out / "csv" / "rank_correlation.csv").read_text().splitlines()))
    # longer names plan worse; idm with the shortest drives worst, and the other three drive alike
    assert next(row for row in rho if (row["metric"], row["score"]) == ("ADE [m]", "DS"))["kendall"].startswith("-0.7")
    words = (out / "paper.md").read_text()
    assert words.count("Not comparable") == words.count("Comparable to CARLA") == 9
    assert "QUICK" not in words
    before, calls = (out / "paper.json").read_bytes(), called(suite)
    again = study(suite)
    assert (again.exit_code, called(suite), len(called(suite, "shown"))) == (0, calls, 8)
    assert (out / "paper.json").read_bytes() == before


@pytest.mark.slow
def test_every_table_and_figure_of_a_quick_study_says_so(suite: Path) -> None:
    humans = HumanStudyFolder.create(suite.parent / "humans", make_plan(), "persons").folder
    ended = study(suite, "--quick", "--human-study", humans, agents="idm,sharing")
    assert ended.exit_code == 0, ended.output
    out = suite.parent / "out"
    files = [*(out / "csv").iterdir(), *(out / "latex").glob("[!a]*"), *(out / "figures").iterdir()]
    assert files and all(path.name.startswith("quick_") for path in files)
    words = (out / "paper.md").read_text()
    titles = [line for line in words.splitlines() if line.startswith("### ")]
    assert titles and all(line.startswith("### QUICK: ") for line in titles)
    assert all("QUICK: " in path.read_text() for path in (out / "latex").glob("quick_*"))
    assert "These numbers are no results" in words
    assert f"persons | {NO_PERSON}" in words
    assert "These numbers are no results" in (out / "paper.html").read_text()


@pytest.mark.slow
def test_an_interrupted_study_goes_on_and_agents_may_be_added(suite: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    drive = paper_fakes.drive

    def stop_at_idm(job: EpisodeJob) -> ScenarioResult:
        if job.agent.name == "idm":
            raise KeyboardInterrupt
        return drive(job)

    monkeypatch.setattr(paper_fakes.find_module("runs.evaluate"), "run_job", stop_at_idm)
    stopped = study(suite, agents="sharing,idm")
    assert stopped.exit_code == 130
    assert stopped.stderr.splitlines()[-1].startswith("interrupted; the same command without --fresh continues")
    before = called(suite)
    monkeypatch.setattr(paper_fakes.find_module("runs.evaluate"), "run_job", drive)
    ended = study(suite, agents="sharing,idm,stationary")
    assert ended.exit_code == 0, ended.output
    after = called(suite)
    assert after[: len(before)] == before and len(set(after)) == len(after), "nothing is driven twice"
    assert len(after) == 6 + 2 + 6 + 2


@pytest.mark.parametrize(
    ("given", "agents", "problem"),
    [
        ((), "sharing,idn", "agent 'idn': expected stationary"),
        ((), "sharing,", "expected different agents with commas between them"),
        ((), "sharing,sharing", "expected different agents with commas between them"),
        ((), "perception-swap:cobevt:profile", r"expected an agent besides perception-swap:\*:profile"),
        ((), "idm,codriving", "manifest of weights .*codriving-encoder.json: cannot be read"),
        ((), "idm,perception-swap:cobevt", "manifest of weights .*cobevt-encoder.json: cannot be read"),
        (("--agent-config", "single=a.json"), "idm", "expected AGENT=FILE with one of --agents, found 'single=a.json'"),
        (("--detectors", "absent.json"), "idm", "absent.json: cannot be read"),
        (("--seeds", "0"), "idm", "0 is not in the range"),
        (("--quick", "--all-scenarios"), "idm", "expected --quick or --all-scenarios, found both"),
        (("--human-study", "absent"), "idm", "absent: expected the folder of a study with study.json, found none"),
    ],
)
def test_bad_input_is_one_sentence_and_leaves_no_folder(
    suite: Path, given: tuple[str, ...], agents: str, problem: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mdrive_sumo.agents.learned.fusion_network.WEIGHTS_FOLDER", suite)
    ended = study(suite, *given, agents=agents)
    assert (ended.exit_code, called(suite)) == (2, [])
    assert re.search(problem, ended.output) and ended.stderr.count("Error: ") == 1
    assert not (suite.parent / "out").exists()


def test_the_folder_of_something_else_is_left_alone(suite: Path) -> None:
    other = suite.parent / "out"
    other.mkdir()
    (other / "gain.json").write_text("{}")
    ended = study(suite)
    assert ended.exit_code == 2 and "found gain.json in it" in ended.output
    assert [path.name for path in other.iterdir()] == ["gain.json"] and called(suite) == []


@pytest.mark.slow
def test_another_study_is_refused_unless_it_starts_anew(suite: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert study(suite, agents="idm").exit_code == 0
    calls = called(suite)
    other = study(suite, "--seed", "3", agents="idm")
    assert other.exit_code == 2 and "found one with another seeds; --fresh starts anew" in other.output
    monkeypatch.setattr("mdrive_sumo.study.paper.study_folder.compute_code_checksum", lambda: "sha256:other")
    changed = study(suite, agents="idm")
    assert changed.exit_code == 2 and "another code of mdrive-sumo" in changed.output
    assert called(suite) == calls
    fresh = study(suite, "--fresh", "--seed", "3", agents="idm")
    assert fresh.exit_code == 0, fresh.output
    assert len(called(suite)) == 2 * len(calls)


@pytest.mark.slow
def test_seeds_are_one_run_and_every_episode_is_in_the_numbers(suite: Path) -> None:
    precisions = DetectorSummary({"none": {}}, {"none": {COMPARED[0]: ConfidenceInterval(0.7, None, None, 3)}}, {}, {})
    (suite / "detectors.json").write_text(write_detectors_json(precisions))
    agents = "sharing,idm,stationary,perception-swap:cobevt:profile"
    given = ("--seeds", "2", "--all-scenarios", "--detectors", suite / "detectors.json")
    ended = study(suite, *given, agents=agents)
    assert ended.exit_code == 0, ended.output
    page = json.loads((suite.parent / "out" / "paper.json").read_text())
    assert (page["seeds"], page["scale"]) == ([0, 1], "whole")
    found = [(one["id"], one["seed"]) for one in page["closed"]["sharing"]["episodes"]]
    assert found == [("s0", 0), ("s0", 1), ("s1", 0), ("s1", 1)]
    assert page["open_closed"]["scenarios"] == 2
    assert page["precisions"]["AP@0.5 clean"] == {"none": 70.0}
    (surrogate,) = csv.DictReader((suite.parent / "out" / "csv" / "detectors.csv").read_text().splitlines())
    assert (surrogate["detector"], surrogate["AP@0.5 clean"]) == ("cobevt:profile", ""), "no detector runs in it"


@pytest.mark.slow
def test_agents_that_cannot_start_are_left_out_and_named(suite: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mdrive_sumo.agents.learned.fusion_network.WEIGHTS_FOLDER", suite)
    known = dict.fromkeys(("idm", "colmdriver", "codriving"))
    monkeypatch.setattr("mdrive_sumo.study.paper.paper_agents.AGENTS", known)
    ended = invoke("study", "paper", "--suite", suite, "--out", suite.parent / "out", "--workers", "1")
    assert ended.exit_code == 0, ended.output
    assert "left out: colmdriver: language model: option endpoint" in ended.stderr
    words = (suite.parent / "out" / "paper.md").read_text()
    assert "Left out: colmdriver: language model" in words
    assert "Left out: codriving: manifest of weights codriving-encoder.json: cannot be read" in words, "no whole path"


@pytest.mark.slow
def test_an_agent_that_fails_in_open_loop_only_is_exit_code_1(suite: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(job: OpenLoopJob) -> OpenLoopScenario:
        return paper_fakes.show(job).model_copy(update={"failures": {"1": "too fast"}})

    monkeypatch.setattr(paper_fakes.find_module("open_loop.evaluate_open"), "run_open_loop_job", fail)
    ended = study(suite, agents="idm")
    assert ended.exit_code == 1
    assert "THE AGENT idm FAILED in 2 recordings of the open loop" in ended.stderr


@pytest.mark.slow
def test_void_scenarios_are_exit_code_1_and_named(suite: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(job: EpisodeJob) -> ScenarioResult:
        if (job.agent.name, job.scenario) == ("sharing", "s0"):
            raise ValueError("boom")
        return paper_fakes.drive(job)

    monkeypatch.setattr(paper_fakes.find_module("runs.evaluate"), "run_job", fail)
    ended = study(suite, agents="sharing,idm")
    assert ended.exit_code == 1, ended.output
    words = (suite.parent / "out" / "paper.md").read_text()
    assert "episodes are void" in words
