"""The same numbers in a fresh process and a used one, by one worker or two (all 46 scenarios: test_verify)."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
from testing.local_executor import run_in_process
from testing.short_suite import make_short_suite
from testing.study_samples import invoke

from mdrive_sumo.cli import main

COMMAND = [sys.executable, "-c", f"import {main.__module__} as cli; cli.main()"]
SAMPLE = "*ins_chaos*"


TALKING = ("sharing", "colmdriver-rule", "sharing+negotiation", "perception-swap:cobevt:profile")
WORN = ("--comm-loss", "0.3", "--comm-latency", "2", "--pose-error", "0.6,0.6")


def evaluated(out: Path, scenario: str, *more: str, agent: str = "idm") -> dict[str, str]:
    """Digest by scenario id of a run through the real command line."""
    arguments = ["eval", "--suite", "interdrive@0", "--agent", agent, "--scenario", scenario, "--out", str(out), *more]
    subprocess.run([*COMMAND, *arguments], check=True, capture_output=True, timeout=600)
    results = json.loads((out / "results.json").read_text())
    return {row["id"]: row["digest"] for row in results["scenarios"]}


@pytest.mark.full
def test_worker_count_and_process_age_do_not_change_a_digest(tmp_path: Path) -> None:
    used = evaluated(tmp_path / "one", SAMPLE, "--workers", "1")
    assert len(used) == 4
    assert evaluated(tmp_path / "two", SAMPLE, "--workers", "2") == used
    for scenario, digest in used.items():
        fresh = evaluated(tmp_path / scenario, scenario, "--workers", "1")
        assert fresh == {scenario: digest}


@pytest.mark.slow
def test_worn_messages_are_the_same_in_this_process_and_in_two_workers(tmp_path: Path) -> None:
    """Two scenarios of a few seconds; whole ones below."""
    suite = make_short_suite(tmp_path / "suite", "i10*", "i13*", metres=8)

    def drive(name: str, workers: int) -> list[dict[str, Any]]:
        out = ("--agent", "sharing+negotiation", "--workers", workers, "--no-record", "--out", tmp_path / name)
        ended = invoke("eval", "--suite", suite, *WORN, *out)
        assert ended.exit_code == 0, ended.output
        return json.loads((tmp_path / name / "results.json").read_text())["scenarios"]

    two = drive("two", 2)
    assert len(two) == 2 and all(row["comm"]["lost"] > 10 for row in two)
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        assert drive("one", 1) == two


@pytest.mark.full
@pytest.mark.parametrize("agent", ("single", *TALKING))
def test_loss_and_noise_are_the_same_for_any_worker_count(agent: str, tmp_path: Path) -> None:
    sample = "i1[03]*"
    one = evaluated(tmp_path / "one", sample, "--workers", "1", *WORN, agent=agent)
    assert len(one) == 2
    assert evaluated(tmp_path / "two", sample, "--workers", "2", *WORN, agent=agent) == one
    verify = [*COMMAND, "verify", str(tmp_path / "two"), "--workers", "1"]
    said = subprocess.run(verify, check=True, capture_output=True, text=True, timeout=600).stdout
    assert said.splitlines()[-1] == "2 of 2 scenarios are identical"


@pytest.mark.full
@pytest.mark.parametrize("agent", TALKING)
def test_loss_changes_what_is_driven_and_another_seed_too(agent: str, tmp_path: Path) -> None:
    ideal = evaluated(tmp_path / "ideal", "i13*", "--workers", "1", agent=agent)
    worn = evaluated(tmp_path / "worn", "i13*", "--workers", "1", *WORN, agent=agent)
    other = evaluated(tmp_path / "other", "i13*", "--workers", "1", *WORN, "--seed", "1", agent=agent)
    assert ideal != worn != other != ideal


@pytest.mark.full
def test_the_whole_suite_is_the_same_with_loss_and_noise(tmp_path: Path) -> None:
    one = evaluated(tmp_path / "one", "*", "--workers", "1", *WORN, agent="sharing+negotiation")
    assert len(one) == 46
    assert evaluated(tmp_path / "two", "*", "--workers", "2", *WORN, agent="sharing+negotiation") == one
