"""`study seasons`: means over seasons, intervals, what fresh seasons cost, given runs, bad input."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import Result
from testing import study_fakes
from testing.local_executor import LocalExecutor
from testing.season_suites import package_seasons
from testing.study_samples import invoke, make_run, make_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.scoring import Results, ScenarioResult
from mdrive_sumo.study.seasons import SeasonRow, summarise_seasons

SCENARIOS = 12


def run(agent: str, season: int, mean: float, seed: int = 0, **facts: object) -> Results:
    """Scenarios around a mean, named apart in each season."""
    scores = (make_scenario(f"{season}_{i}", mean + (i - (SCENARIOS - 1) / 2), seed) for i in range(SCENARIOS))
    suite = f"mdrive@{season}" if season else "mdrive"
    about = {"agent": agent, "suite": suite, "suite_checksum": f"sha256:{season}"} | facts
    return make_run(*scores, **about)


def row(agent: str, season: int, mean: float, **facts: object) -> SeasonRow:
    return SeasonRow(agent, str(season), tuple(run(agent, season, mean + seed, seed, **facts) for seed in (0, 1)))


ROWS = [
    *(row("memory", season, mean) for season, mean in enumerate((90.0, 55.0, 60.0, 62.0))),
    *(row("idm", season, mean) for season, mean in enumerate((70.0, 69.0, 71.0, 70.0))),
]


def test_means_losses_and_intervals_over_the_places_of_each_season() -> None:
    summary = summarise_seasons(ROWS)
    memory, idm = summary.lines["ds"]
    assert summary.seasons == ("0", "1", "2", "3") and summary.void == 0
    assert memory.by_season == pytest.approx({"0": 90.5, "1": 55.5, "2": 60.5, "3": 62.5})
    assert (memory.mean.mean, memory.mean.units) == (pytest.approx(67.25), SCENARIOS)
    assert memory.fresh_loss is not None and idm.fresh_loss is not None
    assert memory.fresh_loss.mean == pytest.approx(-31.0) and memory.fresh_loss.is_clear
    assert idm.fresh_loss.mean == pytest.approx(0.0) and not idm.fresh_loss.is_clear
    assert idm.mean.ends is not None and idm.fresh_loss.ends is not None
    narrow, wide = (ends[1] - ends[0] for ends in (idm.mean.ends, idm.fresh_loss.ends))
    assert wide / narrow == pytest.approx((1 + 1 / 3) ** 0.5 / (1 / 4) ** 0.5, rel=0.1), "variances of strata add up"


def test_one_season_has_an_interval_and_no_loss() -> None:
    (line,) = summarise_seasons([row("idm", 0, 50.0)]).lines["ds"]
    assert line.mean.ends is not None and line.fresh_loss is None
    (line,) = summarise_seasons([row("idm", 0, 50.0), row("idm", 1, 40.0)]).lines["ds"]
    assert line.fresh_loss is not None and line.fresh_loss.mean == -10.0 and line.fresh_loss.is_clear


@pytest.mark.parametrize(
    ("change", "sentence"),
    [
        (row("idm", 1, 1.0, suite="interaction@1"), "one suite, found mdrive and interaction"),
        (row("idm", 1, 1.0, score_mode="hard"), "one score mode, found mdrive and hard"),
        (row("idm", 0, 1.0, suite_checksum="sha256:other"), "one checksum of the suite, found sha256:0 and"),
        (SeasonRow("idm", "1", (run("idm", 1, 1.0),)), r"one set of seeds, found \(0, 1\) and \(0,\)"),
        (row("idm", 1, 1.0), "a run of single in season 1, found none"),
    ],
)
def test_runs_that_do_not_belong_together_are_refused(change: SeasonRow, sentence: str) -> None:
    with pytest.raises(InputError, match=sentence):
        summarise_seasons([row("single", 0, 1.0), change])


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[tuple[str, str, int]]:
    """Seasons 0 to 2 with three scenarios each; in season 0 `take-turns` scores what `omniscient` does."""
    scenario = load_suite("interdrive@0").scenarios[1]
    assert isinstance(scenario, Scenario)
    package_seasons(tmp_path / "scenarios", 2, scenario, monkeypatch)
    jobs: list[tuple[str, str, int]] = []

    def drive(job: EpisodeJob) -> ScenarioResult:
        season = "2" if "season_2" in str(job.suite_folder) else "1" if "season_1" in str(job.suite_folder) else "0"
        jobs.append((job.agent.name, season, job.seed))
        knows = (job.agent.name, season) == ("take-turns", "0")
        return study_fakes.drive(replace(job, agent=AgentSpec("omniscient")) if knows else job)

    monkeypatch.setattr("mdrive_sumo.runs.evaluate.make_executor", LocalExecutor)
    monkeypatch.setattr("mdrive_sumo.runs.evaluate.run_job", drive)
    return jobs


def study(tmp_path: Path, *more: str | Path, agents: str = "take-turns,idm") -> Result:
    return invoke("study", "seasons", "--agents", agents, "--out", tmp_path / "out", "--workers", "1", *more)


@pytest.mark.slow
def test_one_command_drives_all_and_a_second_one_nothing(calls: list[tuple[str, str, int]], tmp_path: Path) -> None:
    ended = study(tmp_path, "--seasons", "0-2", "--seeds", "2")
    assert ended.exit_code == 0, ended.output
    assert len(calls) == 2 * 3 * 2 * 3
    page = json.loads((tmp_path / "out" / "seasons.json").read_text())
    assert list(page["seasons"]) == ["0", "1", "2"] and len(set(page["seasons"].values())) == 3
    assert page["lines"]["ds"][0]["fresh_loss"]["mean"] == pytest.approx(-20.0)
    text = (tmp_path / "out" / "seasons.md").read_text()
    assert "# mdrive over seasons" in text and "- mdrive@0: checksum `sha256:" in text
    lines = list(csv.DictReader((tmp_path / "out" / "seasons.csv").read_text().splitlines()))
    assert [(line["metric"], line["agent"]) for line in lines] == [
        (metric, agent) for metric in ("ds", "sr") for agent in ("take-turns", "idm")
    ]
    before = (tmp_path / "out" / "seasons.json").read_bytes()
    again = study(tmp_path, "--seeds", "2")
    assert again.exit_code == 0, again.output
    assert len(calls) == 36
    given = [word for path in (tmp_path / "out" / "runs").glob("*/season_*") for word in ("--runs", path)]
    again = invoke("study", "seasons", "--agents", "none", "--out", tmp_path / "again", *given)
    assert again.exit_code == 0, again.output
    assert len(calls) == 36
    read = json.loads((tmp_path / "again" / "seasons.json").read_text())
    by_agent = {line["agent"]: line for line in read["lines"]["ds"]}
    assert all(by_agent[line["agent"]] == line for line in json.loads(before)["lines"]["ds"])


@pytest.mark.parametrize(
    ("more", "sentence"),
    [
        (("--seasons", "0-7"), "suite 'mdrive@3': expected one of mdrive@0, mdrive@1, mdrive@2, found another season"),
        (("--seasons", "2-0"), "expected a range such as 0-3, found '2-0'"),
        (("--seasons", "0,,1"), "expected numbers, ranges and folders, found '0,,1'"),
        (("--seasons", "1,1"), "expected each once, found 1 twice"),
        (("--seasons", "nowhere"), "suite 'nowhere': expected a folder or one of"),
        (("--suite", "mine"), "expected one of hard, interdrive, interaction, v2xpnp, mdrive, mdrive-40, found 'mine'"),
        (("--suite", "mdrive@1"), "found 'mdrive@1'"),
    ],
)
@pytest.mark.usefixtures("calls")
def test_bad_input_is_one_sentence(more: tuple[str, ...], sentence: str, tmp_path: Path) -> None:
    ended = study(tmp_path, *more)
    assert (ended.exit_code, "Traceback" in ended.output) == (2, False)
    assert sentence in ended.stderr


def test_given_runs_must_have_seasons_and_seeds_once(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    given = {"mine": run("idm", 0, 50.0, suite="mine"), "a": run("idm", 0, 50.0), "b": run("idm", 0, 52.0)}
    given["part"] = given["a"].model_copy(update={"planned": 20})
    monkeypatch.setattr("mdrive_sumo.study.seasons.load_results", lambda place: given[place.name])
    for name in given:
        (tmp_path / name).touch()
    for names, sentence in (
        (("mine",), "expected a run of a suite with seasons, found mine"),
        (("a", "b"), "agent idm, season 0: expected each seed once, found (0, 0)"),
        (("part",), "expected a finished run, found 12 of 20"),
        ((), "expected --agents or --runs, found neither"),
    ):
        ended = study(tmp_path, *(word for name in names for word in ("--runs", tmp_path / name)), agents="none")
        assert ended.exit_code == 2 and sentence in ended.stderr, ended.output
