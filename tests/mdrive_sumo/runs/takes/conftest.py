"""Shared by the tests of takes: a short suite, and a take of its scenario with hand-overs and texts."""

from pathlib import Path
from shutil import copytree

import pytest
from testing.short_suite import make_short_suite
from testing.takes import PERSON, SCENARIO, SHARING, ProgrammedActions, let_drive, list_egos, make_take, record_take

from mdrive_sumo.contract import REMARK, Note
from mdrive_sumo.runs.takes import Action


@pytest.fixture(scope="session")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_short_suite(tmp_path_factory.mktemp("suite"), SCENARIO, metres=20)


@pytest.fixture(scope="session")
def recorded_take(tmp_path_factory: pytest.TempPathFactory, suite: Path) -> Path:
    """A person drives, hands over to `sharing` for 1.5 s, and drives to the goal."""
    run = make_take(tmp_path_factory.mktemp("recorded") / "take", suite)
    actions = {
        0: Action(PERSON, notes=(Note(REMARK, "begin"),)),
        30: Action(SHARING, texts=("it drives",)),
        60: Action(PERSON, texts=("I drive again", "ü")),
    }
    record_take(run, let_drive(list_egos(run), ProgrammedActions(actions)))
    return run.folder


@pytest.fixture
def take(recorded_take: Path, tmp_path: Path) -> Path:
    """A copy that a test may change."""
    return copytree(recorded_take, tmp_path / "take")
