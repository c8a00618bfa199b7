"""The same seed gives the same numbers: one worker or two, a fresh process or a used one, real simulation."""

import json
import os
import signal
import subprocess
import sys
import time
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


@pytest.mark.slow
def test_the_seed_reaches_the_recording(tmp_path: Path) -> None:
    one = evaluated(tmp_path / "0", "i01*", "--seed", "0")
    assert evaluated(tmp_path / "0b", "i01*", "--seed", "0") == one


@pytest.mark.full
@pytest.mark.timeout(1200)
def test_all_46_interrupted_or_not(tmp_path: Path) -> None:
    whole = evaluated(tmp_path / "whole", "*", "--workers", "2")
    assert len(whole) == 46
    arguments = ["eval", "--agent", "idm", "--out", str(tmp_path / "cut"), "--workers", "1"]
    with subprocess.Popen([*COMMAND, *arguments], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as child:
        journal = tmp_path / "cut" / "journal.jsonl"
        while not journal.exists() or len(journal.read_bytes().splitlines()) < 10:
            time.sleep(0.1)
        os.kill(child.pid, signal.SIGKILL)
    assert evaluated(tmp_path / "cut", "*", "--workers", "1") == whole
