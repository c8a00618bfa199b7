"""`study cross-play` and `study penetration`: numbers by hand, files, a study that is continued, bad input."""

import csv
import json
from pathlib import Path

import pytest
from click.testing import Result
from testing.local_executor import TALKER
from testing.short_suite import make_short_suite
from testing.study_samples import invoke, make_run, make_scenario

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.cli.study_agents import list_all_agents
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scoring import EgoResult, ScenarioResult
from mdrive_sumo.study.cross_play import summarise_cross_play
from mdrive_sumo.study.penetration import summarise_penetration
from mdrive_sumo.study.two_agents import ALL, OTHER, TESTED, TwoAgentRow

SCENARIOS = ("a", "b")


def make_ego(name: str, ds: float, *, is_other: bool = False) -> EgoResult:
    values = {"id": name, "outcome": "arrived", "reason": "", "ds": ds, "rc": ds, "ip": 1.0, "infractions": []}
    return EgoResult.model_validate(values | {"is_other": is_other})


def make_row(
    agent: str, others: str, penetration: int | None, *egos: EgoResult, void: tuple[str, ...] = ()
) -> TwoAgentRow:
    """The same CAVs in every scenario."""
    scenarios: list[ScenarioResult] = []
    for name in SCENARIOS:
        if name in void:
            scenarios.append(make_scenario(name, 0.0, status="void", reason="SUMO ended"))
        else:
            scenarios.append(make_scenario(name, sum(ego.ds for ego in egos) / len(egos), egos=egos))
    return TwoAgentRow(agent, others, penetration, (make_run(*scenarios),))


def make_pair(agent: str, others: str, tested_ds: float, void: tuple[str, ...] = ()) -> TwoAgentRow:
    egos = make_ego("0", tested_ds), make_ego("1", 10.0, is_other=True)
    return make_row(agent, others, None, *egos, void=void)


def make_pairs(void: tuple[str, ...] = ()) -> list[TwoAgentRow]:
    scores = {("x", "x"): 100.0, ("x", "y"): 60.0, ("x", "z"): 50.0, ("y", "x"): 80.0, ("y", "y"): 70.0}
    scores |= {("y", "z"): 90.0, ("z", "x"): 0.0, ("z", "y"): 20.0, ("z", "z"): 40.0}
    return [make_pair(*pair, ds, void=void if pair == ("x", "y") else ()) for pair, ds in scores.items()]


def test_with_strangers_is_the_mean_among_all_other_agents() -> None:
    summary = summarise_cross_play(make_pairs())
    assert {agent: one["ds"].mean for agent, one in summary.with_strangers.items()} == {"x": 55.0, "y": 85.0, "z": 10.0}
    assert {agent: one["ds"].mean for agent, one in summary.loss.items()} == {"x": -45.0, "y": 15.0, "z": -30.0}
    assert summary.cells["x", "x"]["sr"].mean == 100.0
    assert summary.cells["x", "y"]["ds"].mean == 60.0, "the CAVs of the others do not count"
    assert (summary.scenarios, summary.void) == (2, 0)


def test_a_scenario_that_is_void_in_one_run_counts_in_none() -> None:
    summary = summarise_cross_play(make_pairs(void=("a",)))
    assert (summary.scenarios, summary.void) == (1, 1)
    with pytest.raises(InputError, match="expected scenarios that are void in no run, found none"):
        summarise_cross_play(make_pairs(void=SCENARIOS))


def test_every_role_has_its_means_at_every_penetration() -> None:
    rows = [
        make_row("x", "single", 0, make_ego("0", 40.0), make_ego("1", 60.0)),
        make_row("x", "single", 50, make_ego("0", 100.0), make_ego("1", 70.0, is_other=True)),
        make_row("x", "single", 100, make_ego("0", 100.0), make_ego("1", 90.0)),
    ]
    none, half, every = summarise_penetration(rows).lines
    assert {role: one["ds"].mean for role, one in none.score.items()} == {ALL: 50.0, OTHER: 50.0}
    assert {role: one["ds"].mean for role, one in half.score.items()} == {ALL: 85.0, TESTED: 100.0, OTHER: 70.0}
    assert {role: one["ds"].mean for role, one in every.score.items()} == {ALL: 95.0, TESTED: 95.0}
    assert [line.difference["ds"].mean for line in (none, half, every)] == [0.0, 35.0, 45.0]
    assert half.score[TESTED]["sr"].mean == 100.0


@pytest.fixture(scope="module")
def folder(in_process: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    found = tmp_path_factory.mktemp("two-agents")
    make_short_suite(found / "suite", "i01*", metres=6)
    return found


def study(folder: Path, name: str, *more: str) -> Result:
    return invoke("study", name, "--suite", folder / "suite", "--workers", "1", "--out", folder / name, *more)


@pytest.mark.slow
def test_cross_play_from_the_command_line(folder: Path) -> None:
    words = ("--agents", f"{TALKER},stationary")
    first, again = study(folder, "cross-play", *words), study(folder, "cross-play", *words)
    assert (first.exit_code, again.exit_code) == (0, 0), again.output
    assert "scenarios are done already" in again.output
    page = json.loads((folder / "cross-play" / "cross-play.json").read_text())
    by_pair = {(one["agent"], one["others"]): one["ds"]["mean"] for one in page["cells"]}
    assert set(by_pair) == {(a, b) for a in (TALKER, "stationary") for b in (TALKER, "stationary")}
    assert by_pair[TALKER, "stationary"] > 90.0 > 10.0 > by_pair["stationary", TALKER]
    with (folder / "cross-play" / "cross-play.csv").open() as lines:
        assert len(list(csv.DictReader(lines))) == 8
    assert f"| {TALKER} |" in (folder / "cross-play" / "cross-play.md").read_text()
    assert (folder / "cross-play" / "cross-play.svg").read_text().startswith("<?xml")


def test_all_agents_are_those_that_drive_without_options(capsys: pytest.CaptureFixture[str]) -> None:
    assert {*AGENTS} - {*list_all_agents().split(",")} == {"colmdriver", "human", "human-replay"}
    assert capsys.readouterr().err.startswith("left out: colmdriver: language model: option endpoint")


@pytest.mark.slow
def test_penetration_from_the_command_line(folder: Path) -> None:
    words = ("--agents", TALKER, "--others", "stationary", "--penetration", "50")
    ended = study(folder, "penetration", *words)
    assert ended.exit_code == 0, ended.output
    page = json.loads((folder / "penetration" / "penetration.json").read_text())
    by_level = {line["penetration"]: line["score"]["all"]["ds"]["mean"] for line in page["lines"]}
    assert sorted(by_level) == [0, 50, 100]
    assert by_level[0] < by_level[50] < by_level[100]
    assert (folder / "penetration" / "penetration.png").is_file()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "words", "sentence"),
    [
        ("cross-play", ("--agents", "idm"), "expected at least 2 different agents"),
        ("cross-play", ("--agents", "idm,idm"), "expected at least 2 different agents"),
        ("penetration", ("--penetration", "0,50"), "expected different percentages from 1 to 99, found '0,50'"),
        ("penetration", ("--penetration", "half"), "expected different percentages from 1 to 99, found 'half'"),
        ("penetration", ("--agents", "idm", "--others", "idm"), "expected an agent that is not among --agents"),
    ],
)
def test_bad_input_is_one_sentence(folder: Path, name: str, words: tuple[str, ...], sentence: str) -> None:
    ended = study(folder, name, *words)
    assert (ended.exit_code, "Traceback" in ended.output) == (2, False)
    assert sentence in ended.output
