"""Digests agree in environments that compute as another processor would, and differences are told."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from click.testing import CliRunner
from testing.paths import ROOT

from tools import compare_platforms
from tools.compare_platforms import VARIANTS, drive, find_differences, limit_features, main

SHORT = "i07_ins_ss_town"
ALL_AT_ONCE = {name: value for variant in VARIANTS.values() for name, value in variant.items()}
"""Of two variants of a library the last one counts: the older processor."""


def compare_elsewhere(file: Path, variant: dict[str, str]) -> str:
    """Return the last line of the command that drives the episodes of the file in another environment."""
    command = [sys.executable, "-m", "tools.compare_platforms", "compare", str(file)]
    ended = subprocess.run(
        command, cwd=ROOT, env=os.environ | limit_features(variant), capture_output=True, text=True, timeout=900
    )
    return (ended.stdout or ended.stderr).splitlines()[-1]


@pytest.mark.full  # in `make test`: test_portable holds every function against its definition
@pytest.mark.parametrize("agent", ["sharing", "sharing+negotiation"])
def test_another_processor_gives_the_same_digest(agent: str, tmp_path: Path) -> None:
    file = tmp_path / "digests.json"
    file.write_text(json.dumps({"platform": "here", "digests": drive([(SHORT, agent)])}))
    assert compare_elsewhere(file, ALL_AT_ONCE) == "1 of 1 digests agree"


@pytest.mark.full
@pytest.mark.parametrize("variant", VARIANTS)
def test_each_variant_gives_the_same_digests(variant: str, tmp_path: Path) -> None:
    pairs = [
        (scenario, agent) for scenario in (SHORT, "blocked-lane_03", "crossing_032") for agent in ("sharing", "idm")
    ]
    file = tmp_path / "digests.json"
    file.write_text(json.dumps({"platform": "here", "digests": drive(pairs)}))
    assert compare_elsewhere(file, VARIANTS[variant]) == "6 of 6 digests agree"


def test_another_digest_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(compare_platforms, "drive", lambda pairs: {" ".join(pair): "1" for pair in pairs})
    file = tmp_path / "digests.json"
    assert CliRunner().invoke(main, ["write", str(file), "--scenario", "a", "--scenario", "b"]).exit_code == 0
    stored = json.loads(file.read_text())
    assert len(stored["digests"]) == 2 * len(compare_platforms.SAMPLE_AGENTS)
    assert CliRunner().invoke(main, ["compare", str(file)]).exit_code == 0
    stored["digests"]["b sharing+negotiation"] = "2"
    file.write_text(json.dumps(stored))
    found = CliRunner().invoke(main, ["compare", str(file)])
    assert (found.exit_code, "differs: b sharing+negotiation\n9 of 10 digests agree" in found.output) == (1, True)


def test_a_missing_episode_counts_as_a_difference() -> None:
    assert find_differences({"a idm": "1", "b idm": "2"}, {"a idm": "1"}) == ["b idm"]


def test_only_known_features_are_switched_off() -> None:
    assert limit_features({"NPY_DISABLE_CPU_FEATURES": "NO_SUCH_FEATURE", "OPENBLAS_CORETYPE": "Nehalem"}) == {
        "OPENBLAS_CORETYPE": "Nehalem"
    }
