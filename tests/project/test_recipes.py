"""The recipes of CONTRIBUTING.md: their code blocks, applied to a scratch copy of the library, do what they say."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from testing.paths import ROOT

BLOCK = re.compile(r"""^```python title="([^"]+)"(?: after=(["'])([^\n]*)\2)?\n(.*?)^```$""", re.MULTILINE | re.DOTALL)


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The library with every code block of CONTRIBUTING.md applied; the scenarios are links."""
    folder = tmp_path_factory.mktemp("recipes")
    shutil.copytree(
        ROOT / "mdrive_sumo", folder / "mdrive_sumo", ignore=shutil.ignore_patterns("scenarios", "__pycache__")
    )
    (folder / "mdrive_sumo" / "scenarios").symlink_to(ROOT / "mdrive_sumo" / "scenarios")
    for title, _, after, text in BLOCK.findall((ROOT / "CONTRIBUTING.md").read_text("utf-8")):
        apply_block(folder / title, after, text)
    return folder


def apply_block(path: Path, after: str, text: str) -> None:
    """Create a file, or insert lines behind the only line that is equal to `after`."""
    if not after:
        assert not path.exists()
        path.write_text(text, "utf-8")
        return
    lines = path.read_text("utf-8").splitlines(keepends=True)
    (place,) = (number for number, line in enumerate(lines, 1) if line.rstrip("\n") == after)
    path.write_text("".join([*lines[:place], text, *lines[place:]]), "utf-8")


@pytest.mark.slow
def test_a_baseline_and_a_scalar_metric_are_one_file_and_a_line_in_their_registry(scratch: Path) -> None:
    command = ("eval", "--scenario", "i01*", "--agent", "full-brake", "--out", "run", "--no-record")
    done = subprocess.run(
        (sys.executable, "-c", "from mdrive_sumo.cli import main; main()", *command),
        cwd=scratch,
        env=os.environ | {"PYTHONPATH": os.pathsep.join((str(scratch), str(ROOT)))},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    results = json.loads((scratch / "run" / "results.json").read_text())
    assert results["run"]["agent"] == "full-brake"
    assert {ego["rc"] for scenario in results["scenarios"] for ego in scenario["egos"]} == {0.0}
    assert all(scenario["scalars"]["episode_length"] > 0 for scenario in results["scenarios"])
