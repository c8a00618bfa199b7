"""`eval --v2x-rate`: from the command line to every station, the results and `verify`."""

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from testing.short_suite import shorten

from mdrive_sumo.cli import main
from mdrive_sumo.episode import load_episode
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite
from mdrive_sumo.v2x.message_counts import compute_message_rates

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("in_process")]

SCENARIO = "blind-crossing_bbcceae4"
"""Three CAVs and a road-side unit."""


def invoke(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def drive(folder: Path, rate: str) -> Any:
    """Return the results of a run of a short scenario."""
    words = ("--agent", "sharing+negotiation", "--comm", "realistic", "--out", folder / rate, "--score-mode", "mdrive")
    ended = invoke("eval", "--suite", folder / "suite", *words, *(() if rate == "fixed" else ("--v2x-rate", rate)))
    assert ended.exit_code == 0, ended.output
    assert ("messages  " in ended.output) is (rate == "etsi")
    return json.loads((folder / rate / "results.json").read_text())


def test_stations_send_by_the_rules_of_etsi_if_the_run_says_so(tmp_path: Path) -> None:
    scenario = shorten(next(iter(load_suite("hard@0").select(SCENARIO))), 25)
    assert scenario.rsus
    save_suite(Suite(SuiteFile(name="short", title="A short suite"), tmp_path / "suite", (scenario,)))
    fixed, etsi = drive(tmp_path, "fixed"), drive(tmp_path, "etsi")
    assert "v2x_rate" not in fixed["run"] and etsi["run"]["v2x_rate"] == "etsi"
    assert "sent_rates" not in fixed["scenarios"][0]
    sent = etsi["scenarios"][0]["sent_rates"]
    assert {"cam", "cpm", "mcm"} <= set(sent) <= {"cam", "cpm", "mcm", "denm"}
    episode = load_episode(tmp_path / "fixed" / "episodes" / f"{SCENARIO}.npz")
    before = compute_message_rates(episode.messages, episode.ticks)
    for name in ("cam", "cpm", "mcm"):
        assert 0.0 < sent[name]["messages_s"] < 0.8 * before[name].messages_s
        assert 0.0 < sent[name]["bytes_s"] < 0.9 * before[name].bytes_s
    told = load_episode(tmp_path / "etsi" / "episodes" / f"{SCENARIO}.npz")
    (unit,) = scenario.rsus
    sizes = [
        [len(one.message.payload) for one in run.messages if one.message.sender == unit.id] for run in (episode, told)
    ]
    ticks = [one.message.tick for one in told.messages if one.message.sender == unit.id]
    assert all(2 <= later - earlier <= 20 for earlier, later in pairwise(ticks))
    assert 0 < sum(sizes[1]) / told.ticks < 0.5 * sum(sizes[0]) / episode.ticks
    report = (tmp_path / "etsi" / "report.md").read_text()
    assert "| cam |" in report and "v2x rate: etsi" in report
    assert "v2x rate" not in (tmp_path / "fixed" / "report.md").read_text()
    assert invoke("verify", tmp_path / "etsi").exit_code == 0


def test_an_unknown_rate_is_refused_in_one_sentence() -> None:
    ended = invoke("eval", "--v2x-rate", "etis")
    assert ended.exit_code == 2 and "found 'etis'; did you mean 'etsi'?" in " ".join(ended.output.split())
