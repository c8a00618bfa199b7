"""`eval --attack` as a user runs it: labelled, recorded, repeated by `verify`; bad input in one sentence."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner

from mdrive_sumo.cli import main
from mdrive_sumo.episode import ATTACKERS, load_episode
from mdrive_sumo.runs.run_config import RunConfig

SCENARIO = ("--suite", "interdrive@0", "--scenario", "i26_ins_oppo_town", "--workers", "1")
SHORT = ("--suite", "v2xpnp@0", "--scenario", "corridor_014", "--workers", "1")
"""Two CAVs for nine seconds."""


def run(*words: str | Path) -> tuple[int, str]:
    found = CliRunner().invoke(main, [str(word) for word in words])
    return found.exit_code, found.output


@pytest.mark.slow
@pytest.mark.usefixtures("in_process")
def test_an_attacked_run_says_so_everywhere_and_can_be_verified(tmp_path: Path) -> None:
    out = tmp_path / "run"
    code, shown = run("eval", *SHORT, "--agent", "sharing", "--attack", "phantom:share=30", "--out", out)
    assert code in (0, 1), shown
    assert "attacked" in shown
    results = json.loads((out / "results.json").read_text())
    assert results["run"]["attack"] == "phantom:share=30" and "attacked" in results["run"]["labels"]
    assert "- attack: phantom:share=30\n" in (out / "report.md").read_text()
    about = load_episode(next((out / "episodes").rglob("*.npz"))).about
    assert about["attack"] == "phantom:share=30" and about[ATTACKERS] in {"cav_1", "cav_2"}
    assert run("verify", out)[0] == 0


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (("--attack", "phantom:by=nobody"), "expected attackers among"),
        (("--attack", "phantom", "--comm", "off"), "expected a channel over which stations can lie, found --comm off"),
        (("--attack", "phantom:among=rsus"), "expected scenarios with a road-side unit, found none"),
        (("--attack", "lie"), "attack: expected one of none, phantom"),
        (("--attack", "shift:rate=-3"), "rate: expected a number from 0.01 to 50 m/s"),
    ],
)
def test_a_bad_attack_is_refused_before_anything_is_driven(
    tmp_path: Path, words: tuple[str, ...], expected: str
) -> None:

    code, shown = run("eval", *SCENARIO, *words, "--out", tmp_path / "run")
    assert code == 2 and expected in shown and "Traceback" not in shown
    assert not (tmp_path / "run").exists()


def test_honest_runs_keep_their_fingerprint() -> None:
    honest = RunConfig.parse("interdrive", "sharing")
    assert "attack" not in honest.to_dict()
    attacked = RunConfig.parse("interdrive", "sharing", attack="shift:rate=0.30")
    assert attacked.to_dict()["attack"] == "shift"
    assert RunConfig.from_dict(attacked.to_dict()).options == attacked.options
    assert attacked.default_folder("interdrive") != honest.default_folder("interdrive")
