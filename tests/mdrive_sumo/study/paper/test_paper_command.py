"""`study paper` from the command to its files, interrupted and repeated studies, bad input."""

import json
from pathlib import Path

import pytest
from click.testing import Result
from testing import paper_fakes
from testing.study_samples import invoke

AGENTS = "stationary,idm,sharing,constant-speed"


@pytest.fixture
def suite(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    paper_fakes.install(monkeypatch)
    return paper_fakes.make_suite(tmp_path / "suite", "answer", "answer")


def study(suite: Path, *more: str | Path, agents: str = AGENTS, out: str = "out") -> Result:
    folder = suite.parent / out
    return invoke("study", "paper", "--suite", suite, "--agents", agents, "--out", folder, "--workers", "1", *more)


def called(suite: Path, name: str = "calls") -> list[str]:
    return (suite / name).read_text().splitlines() if (suite / name).exists() else []


def test_one_command_writes_everything_and_a_second_one_drives_nothing(suite: Path) -> None:
    ended = study(suite)
    assert ended.exit_code == 0, ended.output
    out = suite.parent / "out"
    page = json.loads((out / "paper.json").read_text())
    print(ended.output)
    assert page["plan"] == {part: ["s0", "s1"] for part in ("closed", "logs", "channel")}
