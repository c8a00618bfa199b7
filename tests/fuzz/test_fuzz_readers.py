"""Every reader of strangers' files is fed with damaged files: it reads or refuses them in one sentence.

`make test-all` spends MDRIVE_FUZZ_S seconds on all readers together, by default 300; MDRIVE_FUZZ_SEED (0) chooses the
damage. With atheris installed the search follows the code that inputs reach, see `testing.fuzz_process`.
"""

import os
import random
import subprocess
import sys
from pathlib import Path

import pytest
from testing.fuzz_damage import damage
from testing.fuzz_process import Harness
from testing.fuzz_targets import TARGETS

SECONDS = float(os.environ.get("MDRIVE_FUZZ_S", "300")) / len(TARGETS)
SEED = int(os.environ.get("MDRIVE_FUZZ_SEED", "0"))
EXAMPLES = 12
"""Inputs of each reader in the fast tests."""


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name, target in TARGETS.items() if not target.native])
def test_some_damaged_files_are_read_or_refused(name: str, tmp_path: Path) -> None:
    harness, draws = Harness(name, tmp_path), random.Random(f"{name} {SEED}")
    assert harness.feed(harness.valid) == ("read", 0)
    for _ in range(EXAMPLES):
        harness.feed(damage(harness.valid, draws))


@pytest.mark.full
@pytest.mark.parametrize("name", TARGETS)
def test_readers_withstand_damaged_files(name: str, tmp_path: Path) -> None:
    command = (sys.executable, "-m", "testing.fuzz_process", name, str(SECONDS), str(SEED), str(tmp_path))
    path = os.pathsep.join(filter(None, sys.path))
    done = subprocess.run(
        command, capture_output=True, text=True, check=False, env=os.environ | {"PYTHONPATH": path}, timeout=900
    )
    if done.returncode < 0 and TARGETS[name].native:
        return  # the library crashed: `limited_reader` makes a sentence of it
    finding = (tmp_path / "finding").read_bytes() if (tmp_path / "finding").is_file() else b""
    assert done.returncode == 0, f"exit code {done.returncode} for {finding!r}\n{done.stderr[-3000:]}"
