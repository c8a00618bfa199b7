"""The registry of metrics is open: one metric more appears in results and reports without other changes."""

import json
from pathlib import Path

import pytest
from testing.score_golden import arriving, ego, episode, scenario, street

from mdrive_sumo.core.state import End
from mdrive_sumo.report.run_report import build_run_report
from mdrive_sumo.scoring import (
    RunInfo,
    ScenarioResult,
    ScoreMode,
    load_results,
    make_void_result,
    save_results,
    score_episode,
    summarize_run,
)
from mdrive_sumo.scoring.metrics import METRICS, EgoTrack, InfractionEvent, InfractionMetric, ScalarMetric, registry

MAX_SPEED = ScalarMetric(
    "max_speed", "max speed [m/s]", lambda scored: float(scored.episode.speed[:, 0].max()), decimals=1
)
"""What the file of a new scalar metric holds."""


def find_haste(track: EgoTrack) -> tuple[InfractionEvent, ...]:
    """Return one infraction, at the first tick above 5 m/s."""
    ticks = (track.speed > 5.0).nonzero()[0]
    return (track.make_infraction("haste", int(ticks[0]), factor=0.9),) if len(ticks) else ()


def score() -> ScenarioResult:
    """Return the score of a CAV that drives at 10 m/s to its goal."""
    about = scenario(ego("0"))
    return score_episode(episode(about, {"0": arriving()}, {"0": End.ARRIVED}), about, street(), ScoreMode.MDRIVE, 0)


@pytest.fixture
def with_max_speed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "METRICS", (*METRICS, MAX_SPEED))


def test_without_further_scalars_the_file_has_no_key_for_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "METRICS", tuple(one for one in METRICS if one.name == "min_ttc"))
    assert "scalars" not in json.loads(score().model_dump_json())


@pytest.mark.usefixtures("with_max_speed")
def test_a_new_scalar_appears_in_the_results_file_and_in_the_report(tmp_path: Path) -> None:
    info = RunInfo(agent="a", suite="s", suite_checksum="c", seed=0, score_mode="mdrive", versions={})
    results = summarize_run(info, [score(), make_void_result(scenario(ego("0"), id="void"), 0, "SUMO stopped")])
    save_results(results, tmp_path / "results.json")
    stored = json.loads((tmp_path / "results.json").read_text())["scenarios"]
    assert list(stored[0]["scalars"]) == ["min_pet", "mean_speed", "comfort", "message_rate", "speeding", "max_speed"]
    assert stored[0]["scalars"]["max_speed"] == 10.0
    assert stored[0]["min_ttc"] is None
    assert "scalars" not in stored[1]
    loaded = load_results(tmp_path / "results.json")
    assert loaded == results
    table = [line.replace(" ", "") for line in build_run_report(loaded).splitlines()]
    means, header = [line for line in table if "maxspeed[m/s]" in line]
    assert means == "|bucket|minPET[s]|speed[m/s]|comfort[%]|messages[B/s]|speeding[%]|maxspeed[m/s]|"
    assert header.endswith(
        "|minTTC[s]|minPET[s]|speed[m/s]|comfort[%]|messages[B/s]|speeding[%]|maxspeed[m/s]|ticks|CAVs|"
    )
    assert "|**scenariomean**|-|10.00|100.0|0|0.0|10.0|" in table


def test_a_new_infraction_multiplies_the_penalty(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "METRICS", (*METRICS, InfractionMetric("haste", find_haste)))
    result = score()
    assert (result.ip, result.ds) == (0.9, 90.0)
    assert [(one.kind, one.tick, one.factor) for one in result.egos[0].infractions] == [("haste", 0, 0.9)]


def test_names_of_metrics_are_unique() -> None:
    names = [metric.name for metric in METRICS]
    assert len(names) == len(set(names))
