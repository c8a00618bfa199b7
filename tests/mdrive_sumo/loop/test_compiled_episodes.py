"""Episodes have the same bits with the compiled layer and with the Python text, tick by tick."""

import json
import os
import subprocess
import sys

import pytest
from testing.paths import ROOT
from testing.random_episodes import draw_episodes

from mdrive_sumo.core.compiled import SWITCH


@pytest.mark.slow
@pytest.mark.parametrize("count", [6, pytest.param(1000, marks=pytest.mark.full)])
def test_random_episodes_have_the_bits_of_the_python_text(count: int) -> None:
    paths = os.pathsep.join((str(ROOT), str(ROOT / "tests")))
    reference = subprocess.Popen(
        (sys.executable, "-m", "testing.random_episodes", str(count)),
        env=os.environ | {SWITCH: "off", "PYTHONPATH": paths},
        cwd=ROOT,
        stdout=subprocess.PIPE,
    )
    found = [[str(episode), episode.drive()] for episode in draw_episodes(count)]
    output, _ = reference.communicate()
    for (name, sums), (expected_name, expected) in zip(found, json.loads(output), strict=True):
        assert name == expected_name
        differing = [i for i, pair in enumerate(zip(sums, expected, strict=False)) if pair[0] != pair[1]]
        assert not differing and len(sums) == len(expected), f"{name}: first at note {differing[:1]} of {len(expected)}"
