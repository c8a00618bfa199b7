"""`study gain`: the parts of the gain, what intervals carry, files, repeated studies, bad input."""

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from click.testing import Result
from testing import study_fakes, suite_fakes
from testing.local_executor import LocalExecutor
from testing.study_samples import invoke, make_run, make_scenario

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import MIN_UNITS, ConfidenceInterval, Verdict, judge_interval
from mdrive_sumo.core.tables import format_cell
from mdrive_sumo.runs.episode_job import EpisodeJob
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.study.gain import AGENTS, CELLS, PARTS, GainRow, GainSummary, SensingProfile, summarise_gain
from mdrive_sumo.study.gain_files import build_gain_table, gain_csv
from mdrive_sumo.study.study_files import count_by_chance, judge_by_metric

MEANS = {
    ("perfect", "single"): 60.0,
    ("perfect", "sharing"): 80.0,
    ("perfect", "sharing+negotiation"): 85.0,
    ("realistic", "single"): 50.0,
    ("realistic", "sharing"): 77.0,
    ("realistic", "sharing+negotiation"): 77.0,
}
"""Occlusion 20, noise 7, intent 0 with a spread over scenarios."""


def score(sensing: str, agent: str, place: int, seed: int) -> float:
    """Intent gains in one scenario what it loses in the other; noise and occlusion gain the same everywhere."""
    both_ways = (1, -1)[place % 2] * 5.0 if (sensing, agent) == ("realistic", "sharing+negotiation") else 0.0
    return MEANS[sensing, agent] + place + seed / 10 + both_ways


def rows(scenarios: int = 2 * MIN_UNITS, seeds: int = 2) -> list[GainRow]:
    return [
        GainRow(
            sensing,
            agent,
            tuple(
                make_run(
                    *(
                        make_scenario(
                            f"s{place}",
                            score(sensing, agent, place, seed),
                            seed,
                            bucket="InterDrive" if place < scenarios / 2 else "Interaction",
                        )
                        for place in range(scenarios)
                    )
                )
                for seed in range(seeds)
            ),
        )
        for sensing in SensingProfile
        for agent in AGENTS
    ]


def gains(summary: GainSummary, group: str = "all") -> dict[str, ConfidenceInterval]:
    return {line.part.name: line.gain["ds"] for line in summary.gains if line.group == group}


@pytest.mark.slow
def test_the_parts_are_what_they_are_called_and_sum_up() -> None:
    summary = summarise_gain(rows())
    found = gains(summary)
    expected = {"occlusion": 20.0, "noise": 7.0, "intent": 0.0, "total": 27.0}
    assert {name: one.mean for name, one in found.items()} == pytest.approx(expected)
    groups = {(line.group, line.scenarios) for line in summary.gains}
    assert groups == {("InterDrive", MIN_UNITS), ("Interaction", MIN_UNITS), ("all", 2 * MIN_UNITS)}
    total = {cell: 0 for part in PARTS for cell in part.terms}
    for part in PARTS:
        for cell, sign in part.terms.items():
            total[cell] += -sign if part.name == "total" else sign
    assert set(total.values()) == {0}, "the parts sum up to the total"


@pytest.mark.slow
def test_only_intervals_without_0_show_a_difference() -> None:
    found = {name: judge_interval(one) for name, one in gains(summarise_gain(rows())).items()}
    assert found == {"occlusion": "gain", "noise": "gain", "intent": "no difference shown", "total": "gain"}


@pytest.mark.slow
@pytest.mark.parametrize("scenarios", [1, MIN_UNITS - 1])
def test_few_scenarios_show_nothing(scenarios: int) -> None:
    """One scenario printed "+26.7 [+26.7, +26.7] ... gain"."""
    summary = summarise_gain([replace(row, results=row.results[:1]) for row in rows(2 * scenarios)])
    assert {judge_interval(one) for one in gains(summary, "InterDrive").values()} == {"too few places"}
    table = build_gain_table(summary)
    assert [*map(format_cell, table.rows[0].cells, table.columns)] == [
        f"InterDrive ({scenarios})", "occlusion", "+20.0 [too few]", "+20.0 [too few]",
        "too few places", "too few places",
    ]  # fmt: skip
    lines = [*csv.DictReader(gain_csv(summary).splitlines())]
    few = [(line["low"], line["high"], line["shown"]) for line in lines if line["group"] != "all"]
    assert {*few} == {("", "", "too few places")}


@pytest.mark.slow
def test_differences_are_paired() -> None:
    """Scores that vary much between scenarios, differences that do not: the interval is narrow."""
    found = gains(summarise_gain(rows()))["occlusion"]
    assert found.ends == pytest.approx((20.0, 20.0))
    spread = np.std([score("perfect", "sharing", place, 0) for place in range(2 * MIN_UNITS)])
    assert spread > 1.0


@pytest.mark.slow
def test_what_is_void_anywhere_counts_nowhere() -> None:
    given = rows(4)
    void = make_scenario("s3", 0.0, 0, bucket="Interaction").model_copy(update={"status": "void"})
    first, *others = given
    broken = make_run(*first.results[0].scenarios[:3], void)
    damaged = [GainRow(first.sensing, first.agent, (broken, *first.results[1:])), *others]
    summary = summarise_gain(damaged)
    assert (summary.void, {line.scenarios for line in summary.gains if line.group == "all"}) == (1, {3})
    nothing = [GainRow(row.sensing, row.agent, (make_run(void),)) for row in given]
    with pytest.raises(InputError, match="void in no run, found none"):
        summarise_gain(nothing)


@pytest.fixture
def calls(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> list[EpisodeJob]:
    """Two scenarios, and an `evaluate` that scores by sensing profile and agent without driving."""
    suite_fakes.make_suite(tmp_path / "suite", "answer", "answer")
    jobs: list[EpisodeJob] = []

    def drive(job: EpisodeJob) -> ScenarioResult:
        jobs.append(job)
        place = int(job.scenario != min(suite_scenarios(tmp_path)))
        ds = score(job.options.sensing, job.agent.name, place, job.seed)
        return study_fakes.drive(job).model_copy(update={"ds": ds, "sr": ds})

    monkeypatch.setattr("mdrive_sumo.runs.evaluate.make_executor", LocalExecutor)
    monkeypatch.setattr("mdrive_sumo.runs.evaluate.run_job", drive)
    return jobs


def suite_scenarios(tmp_path: Path) -> list[str]:
    return [path.parent.name for path in (tmp_path / "suite").glob("*/scenario.json")]


def study(tmp_path: Path, *more: str) -> Result:
    return invoke("study", "gain", "--suite", tmp_path / "suite", "--out", tmp_path / "out", "--workers", "1", *more)


def test_the_study_takes_no_limits_of_agents(tmp_path: Path) -> None:
    """It drives built-in agents only, which have none."""
    ended = study(tmp_path, "--agent-limits", "tick=3")
    assert ended.exit_code == 2 and "No such option '--agent-limits'" in ended.output


@pytest.mark.slow
def test_one_command_makes_the_tables_and_a_second_one_drives_nothing(calls: list[EpisodeJob], tmp_path: Path) -> None:
    ended = study(tmp_path)
    assert ended.exit_code == 0, ended.output
    assert len(calls) == len(CELLS) * 5 * 2
    assert {job.seed for job in calls} == {1, 2, 3, 4, 5}, "seed 0 is the scenario as written"
    out = tmp_path / "out"
    page = json.loads((out / "gain.json").read_text())
    found = {line["part"]: line["ds"] for line in page["gains"]}
    assert (found["occlusion"]["mean"], found["occlusion"]["shown"]) == (20.0, "too few places")
    assert (found["occlusion"]["low"], found["occlusion"]["high"]) == (None, None)
    assert found["occlusion"]["units"] == 1, "both scenarios lie on one place"
    table = (out / "gain.md").read_text()
    assert "| occlusion | +20.0 [too few] |" in table
    assert "too few places" in table and "too few places" in ended.stdout
    lines = list(csv.DictReader((out / "gain.csv").read_text().splitlines()))
    assert {(line["part"], line["metric"]) for line in lines} == {
        (part.name, m) for part in PARTS for m in ("ds", "sr")
    }
    before = (out / "gain.json").read_bytes()
    study(tmp_path)
    assert len(calls) == 50
    assert (out / "gain.json").read_bytes() == before


@pytest.mark.parametrize(
    ("given", "problem"),
    [
        (("--comm", "radio"), "--comm: expected one of ideal"),
        (("--scenario", "nothing*"), "nothing*"),
        (("--seeds", "0"), "0 is not in the range"),
    ],
)
def test_bad_input_is_one_sentence(
    calls: list[EpisodeJob], tmp_path: Path, given: tuple[str, ...], problem: str
) -> None:
    ended = study(tmp_path, *given)
    assert (ended.exit_code, calls) == (2, [])
    assert problem in ended.output


def test_the_sentence_on_chance_corrects_as_the_verdicts_of_its_table_do() -> None:
    """DS and SR are corrected apart: a difference that the table calls a gain is one that the sentence keeps."""
    line = {
        "ds": ConfidenceInterval(5.0, 1.0, 9.0, 20, p_value=0.02),
        "sr": ConfidenceInterval(1.0, -3.0, 5.0, 20, 0.6),
    }
    lines = [line, {**line, "ds": ConfidenceInterval(0.0, -4.0, 4.0, 20, p_value=1.0)}]
    assert judge_by_metric(lines)["ds"] == (Verdict.GAIN, Verdict.NONE)
    told = count_by_chance(lines)
    assert "DS: Of 2 differences" in told and "; 1 remain after" in told.partition("SR:")[0]
    assert "SR: Of 2 differences" in told and "; 0 remain after" in told.partition("SR:")[2]
