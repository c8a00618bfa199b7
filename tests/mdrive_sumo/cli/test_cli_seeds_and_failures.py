"""`eval --seeds`, `eval --fail-fast` and failures of agents, with `suite_fakes` in place of the simulation."""

import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from testing import suite_fakes
from testing.local_executor import LocalExecutor

from mdrive_sumo.cli import main
from mdrive_sumo.core.state import End
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.scoring import ScenarioResult, load_results

Invoke = Callable[..., Result]
TRACEBACK = 'Traceback (most recent call last):\n  File "mine.py", line 7, in act\n    1 / 0\nValueError: no idea\n'


@pytest.fixture
def invoke(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Invoke:
    """Call a command in an empty folder with a suite of two scenarios, without worker processes."""
    suite_fakes.make_suite(tmp_path / "suite", "answer", "answer")
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("mdrive_sumo.runs.evaluate.make_executor", LocalExecutor)
    monkeypatch.setattr("mdrive_sumo.runs.evaluate.run_job", suite_fakes.drive)

    def call(command: str, *words: str) -> Result:
        suite = ("--suite", "suite", "--agent", "stationary") if command == "eval" else ()
        return CliRunner().invoke(main, [command, *words, *suite])

    return call


def load(folder: str) -> Any:
    return json.loads(Path(folder, "results.json").read_text())


def test_several_seeds_are_one_run(invoke: Invoke) -> None:
    """Of scenario sN with seed M the fake driving score is 10 N + M."""
    ended = invoke("eval", "--seed", "1", "--seeds", "3", "--out", "run")
    assert ended.exit_code == 0, ended.output
    found = load("run")
    assert (found["format"], found["run"]["seed"], found["run"]["seeds"]) == ("mdrive-sumo/results/4", 1, [1, 2, 3])
    keys = [(one["id"], one["seed"], one["ds"]) for one in found["scenarios"]]
    assert keys == [(f"s{n}", seed, 10.0 * n + seed) for n in (0, 1) for seed in (1, 2, 3)]
    assert found["overall"]["scenario_mean"]["ds"] == 7.0 and found["buckets"]["Tiny"]["scenarios"] == 2
    assert {str(path.relative_to("run/episodes")) for path in Path("run/episodes").rglob("*.npz")} == {
        f"seed{seed}/s{n}.npz" for seed in (1, 2, 3) for n in (0, 1)
    }
    row = next(line.split() for line in ended.stdout.splitlines() if line.startswith("Tiny") and len(line.split()) == 7)
    assert row[1:4] == ["7.00", "-", "-"] and "too few for an interval" in ended.stdout
    assert "seeds 1, 2, 3" in ended.stdout and "95 % from" in Path("run/report.md").read_text()


def test_a_run_of_one_seed_has_the_files_that_it_had(invoke: Invoke) -> None:
    ended = invoke("eval", "--out", "run")
    assert ended.exit_code == 0 and "95 %" not in ended.stdout
    assert "seeds" not in load("run")["run"] and Path("run/episodes/s0.npz").is_file()


@pytest.mark.slow
def test_a_run_of_several_seeds_continues(invoke: Invoke) -> None:
    words = ("eval", "--seeds", "2", "--out", "run")
    whole = invoke(*words)
    Path("run/episodes/seed1/s0.npz").unlink()
    before = Path("run/calls").read_text().splitlines()
    again = invoke(*words)
    assert "continuing: 3 of 4 scenarios are done already" in again.stderr
    assert Path("run/calls").read_text().splitlines() == [*before, "s0"]
    assert (again.exit_code, again.stdout) == (0, whole.stdout)
    other = invoke("eval", "--seeds", "3", "--out", "run")
    assert other.exit_code == 2 and "another seeds 0,1 (now 0,1,2); --fresh" in other.stderr


def test_results_of_several_seeds_that_cannot_be_are_refused(invoke: Invoke) -> None:
    invoke("eval", "--seeds", "2", "--out", "run")
    assert len(load_results(Path("run/results.json")).scenarios) == 4
    path, good = Path("run/results.json"), load("run")
    for change, sentence in (
        ({"run": good["run"] | {"seeds": [0, 0]}}, "run.seeds: expected different seeds beginning with 0"),
        ({"scenarios": good["scenarios"][:3]}, "scenarios: expected 's1' with seed 1, found none"),
        ({"scenarios": [good["scenarios"][0], *good["scenarios"]]}, "expected every id once, found 's0' 2 times"),
        ({"run": good["run"] | {"seeds": [0, 5]}}, "expected 's0' with seed 5, found none"),
    ):
        path.write_text(json.dumps(good | change))
        ended = invoke("compare", "run", "run")
        assert ended.exit_code == 2 and sentence in ended.stderr, ended.output


def test_compare_names_folders_and_says_which_settings_differ(invoke: Invoke) -> None:
    invoke("eval", "--seeds", "2", "--out", "a")
    invoke("eval", "--comm", "realistic", "--sensing", "perfect", "--out", "b")
    lines = invoke("compare", "a", "b").stdout.splitlines()
    assert lines[:2] == ["A = a (stationary)", "B = b (stationary)"]
    assert re.fullmatch(r"2 scenarios in both, of tiny \([0-9a-f]{12}\)", lines[2])
    assert "warning: A and B differ in seeds: 0, 1 and 0" in lines
    words = [line.split() for line in lines]
    assert ["sensing", "realistic", "perfect"] in words and ["comm", "latency_ticks", "0", "2"] in words
    assert "no setting differs" in invoke("compare", "a", "a").stdout


def test_runs_are_listed(invoke: Invoke, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "no runs below runs" in invoke("list", "runs").stdout
    invoke("eval", "--seeds", "2")
    invoke("eval", "--out", "runs/more/mine")
    Path("runs/more/mine/results.json").unlink()
    found = [line.split() for line in invoke("list", "runs").stdout.splitlines()[2:]]
    assert [row[0] for row in found] == ["runs/more/mine", "runs/tiny-stationary-seeds0-1"]
    assert (found[0][-4:], found[1][2:5], found[1][-1]) == (
        ["partial:", "2", "of", "2"],
        ["stationary", "0,1", "4"],
        "finished",
    )
    assert "found an interrupted one" in invoke("verify", "runs/more/mine").stderr
    assert "did you mean 'runs/tiny-stationary-seeds0-1'?" in invoke("view", "tiny-stationary-seed0-1").stderr


@pytest.fixture
def failing(invoke: Invoke, monkeypatch: pytest.MonkeyPatch) -> Invoke:
    """The agent fails in s1 and its process leaves a traceback."""

    def drive(job: EpisodeJob) -> ScenarioResult:
        result = suite_fakes.drive(job)
        if job.scenario != "s1":
            return result
        assert job.recording is not None
        log = suite_fakes.find_run_folder(job.recording) / "logs" / "s1.0.log"
        log.parent.mkdir(exist_ok=True)
        log.write_text("hello\n" * 20 + TRACEBACK)
        reason = "crashed: ValueError: no idea"
        ego = result.egos[0].model_copy(update={"outcome": End.AGENT_FAILED, "reason": reason})
        return result.model_copy(update={"egos": (ego,)})

    monkeypatch.setattr("mdrive_sumo.runs.evaluate.run_job", drive)
    return invoke


def test_a_failed_agent_ends_with_its_traceback_and_exit_code_1(failing: Invoke) -> None:
    ended = failing("eval", "--out", "run")
    assert ended.exit_code == 1
    lines = ended.stdout.splitlines()
    start = lines.index("THE AGENT FAILED in 1 of 2 episodes (1 CAVs)")
    assert lines[start + 1] == "  first: s1, CAV 0: crashed: ValueError: no idea"
    assert "    ValueError: no idea" in lines[start:] and '      File "mine.py", line 7, in act' in lines[start:]
    assert lines[-1] == "  whole log: run/logs/s1.0.log; all logs: run/logs"
    assert "THE AGENT FAILED" in failing("show", "run").stdout
    assert failing("eval", "--out", "run").exit_code == 1  # already complete


def test_fail_fast_stops_and_the_run_can_be_continued(failing: Invoke) -> None:
    """The longest scenarios start first; these two are alike, so that s0 is driven before s1."""
    ended = failing("eval", "--out", "run", "--fail-fast", "--scenario", "s1", "--scenario", "s0", "--seeds", "2")
    assert ended.exit_code == 1 and "THE AGENT FAILED\n  first: s1, seed 0, CAV 0" in ended.stdout
    assert "stopped; --fresh starts run anew" in ended.stderr and not Path("run/results.json").exists()
    assert Path("run/journal.jsonl").read_text().count('{"result"') == 3  # s0 with both seeds, then s1
    whole = failing("eval", "--out", "run", "--scenario", "s1", "--scenario", "s0", "--seeds", "2")
    assert whole.exit_code == 1 and len(load("run")["scenarios"]) == 4


def test_compare_refuses_two_seasons_unless_told(invoke: Invoke) -> None:
    for folder, suite in (("a", "mdrive"), ("b", "mdrive@1")):
        invoke("eval", "--out", folder)
        found = load(folder)
        Path(folder, "results.json").write_text(json.dumps(found | {"run": found["run"] | {"suite": suite}}))
    refused = invoke("compare", "a", "b")
    assert refused.exit_code == 2 and "found mdrive@0 in A" in refused.stderr and "--mix-seasons" in refused.stderr
    told = invoke("compare", "a", "b", "--mix-seasons")
    assert told.exit_code == 0 and "warning: A and B differ in suite: mdrive@0 and mdrive@1" in told.stdout
