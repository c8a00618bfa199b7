"""The compiled layer does nothing that C leaves undefined: its tests, with a layer that stops at once if it does."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from testing.mutation_job import copy_tree
from testing.paths import ROOT

import hatch_build

TRAPS = ("-fsanitize=undefined,float-cast-overflow,bounds", "-fsanitize-trap=all", "-fno-sanitize=alignment")
"""Shifts, overflows, casts, indices, null pointers: an illegal instruction ends the process. Arrays of NumPy may begin
anywhere, and every machine that the layer is built for reads them."""


@pytest.mark.full
def test_twins_do_nothing_undefined(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tree = copy_tree(ROOT, tmp_path / "tree").folder
    flags = [flag for flag in hatch_build.FLAGS if flag != "-fno-sanitize=all"]
    monkeypatch.setattr(hatch_build, "FLAGS", (*flags, *TRAPS))
    hatch_build.compile_layer(tree, hatch_build.read_version(tree), tree / hatch_build.LAYER, tmp_path / "cache")
    tests = sorted(
        str(path)
        for package in ("mdrive_sumo", "real2sim")
        for path in (tree / "tests" / package).rglob("test_*.py")
        if "compare_twins" in path.read_text()
    )
    assert len(tests) > 5
    paths = os.pathsep.join((str(tree), str(tree / "tests")))
    done = subprocess.run(
        (sys.executable, "-m", "pytest", "-n", "0", "-q", "-x", "-p", "no:cacheprovider", "-m", "not full", *tests),
        cwd=tree,
        env={**os.environ, "PYTHONPATH": paths, "TESTS_PROFILE": "all", "MDRIVE_STRICT_SKIPS": ""},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-3000:]
