"""The same numbers in a fresh process and a used one, by one worker or two (all 46 scenarios: test_verify)."""

import json
import subprocess
import sys
from pathlib import Path

import pytest

from mdrive_sumo.cli import main

COMMAND = [sys.executable, "-c", f"import {main.__module__} as cli; cli.main()"]
SAMPLE = "*ins_chaos*"


def evaluated(out: Path, scenario: str, *more: str) -> dict[str, str]:
    """Digest by scenario id of a run through the real command line."""
    arguments = ["eval", "--agent", "idm", "--scenario", scenario, "--out", str(out), *more]
    subprocess.run([*COMMAND, *arguments], check=True, capture_output=True, timeout=600)
    results = json.loads((out / "results.json").read_text())
    return {row["id"]: row["digest"] for row in results["scenarios"]}


@pytest.mark.slow
def test_worker_count_and_process_age_do_not_change_a_digest(tmp_path: Path) -> None:
    used = evaluated(tmp_path / "one", SAMPLE, "--workers", "1")
    assert len(used) == 4
    assert evaluated(tmp_path / "two", SAMPLE, "--workers", "2") == used
    for scenario, digest in used.items():
        fresh = evaluated(tmp_path / scenario, scenario, "--workers", "1")
        assert fresh == {scenario: digest}
