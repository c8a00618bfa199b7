"""Takes: a program drives in place of a person; the run folder is one on which every command works."""

from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.short_suite import make_short_suite
from testing.takes import PERSON, ProgrammedActions, drive_gently, make_take, record_take

from mdrive_sumo.cli import main
from mdrive_sumo.runs.takes import Action, DriverChoice

pytestmark = pytest.mark.usefixtures("in_process")


def invoke(*words: str | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_short_suite(tmp_path_factory.mktemp("suite"), "i01_*", metres=20)


def test_a_take_with_hand_overs_and_a_text_verifies(tmp_path: Path, suite: Path) -> None:
    run = make_take(tmp_path / "take", suite, "i01_*")
    first, *others = [ego.id for ego in run.scenarios[0].egos]
    actions = {
        0: Action(PERSON),
        30: Action(DriverChoice("sharing"), texts=("I let it drive",)),
        60: Action(PERSON, texts=("and drive again",)),
    }
    sources = {first: ProgrammedActions(actions, drive_gently)}
    sources |= {ego: ProgrammedActions({0: Action(DriverChoice("sharing"))}, drive_gently) for ego in others}
    record = record_take(run, sources)
    assert record.ticks > 60
    ended = invoke("verify", run.folder, "--workers", 1)
    assert ended.exit_code == 0, ended.output
