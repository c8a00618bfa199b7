"""Run folders that strangers send are fed to every command that reads one: no traceback, nothing written elsewhere.

A tenth of the seconds of `test_fuzz_readers` is theirs; MDRIVE_FUZZ_SEED chooses what is done to them.
"""

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest
from testing.fuzz_runs import RunHarness

SECONDS = float(os.environ.get("MDRIVE_FUZZ_S", "300")) / 10
SEED = int(os.environ.get("MDRIVE_FUZZ_SEED", "0"))


@pytest.mark.slow
def test_commands_withstand_some_hostile_runs(tmp_path: Path) -> None:
    harness, draws = RunHarness(tmp_path), random.Random(f"some runs {SEED}")
    for _ in range(8):
        harness.try_run(draws, commands=4)
    assert harness.commands == 32


@pytest.mark.full
def test_commands_withstand_hostile_runs(tmp_path: Path) -> None:
    command = (sys.executable, "-m", "testing.fuzz_runs", str(SECONDS), str(SEED), str(tmp_path))
    path = os.pathsep.join(filter(None, sys.path))
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": path}, timeout=900
    )
    assert done.returncode == 0, done.stdout[-5000:] + done.stderr[-3000:]
