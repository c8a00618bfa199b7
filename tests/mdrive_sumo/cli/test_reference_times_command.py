"""`mdrive-sumo reference-times`: from a run of `omniscient` to time ratios, and the runs that it refuses."""

import json
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing import suite_fakes
from testing.journals import rewrite_journal

from mdrive_sumo.cli import main
from mdrive_sumo.scenario.reference_times import REFERENCE_TIMES_FILE
from mdrive_sumo.scenario.suite import Suite, SuiteFile, load_suite, save_suite
from mdrive_sumo.scoring import load_results

pytestmark = pytest.mark.usefixtures("in_process")

TOWN = "i07_ins_ss_town"
REFERENCE = ("--agent", "omniscient", "--ids", "scenario", "--sensing", "perfect")


def command(*words: str | int | Path) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


def slow(folder: Path) -> Path:
    path = folder / "slow.json"
    path.write_text('{"speed": 3.0}')
    return path


@pytest.mark.slow
def test_a_run_of_omniscient_becomes_the_reference_and_results_follow_it(tmp_path: Path) -> None:
    """A suite of one's own: undefined before the times are known, then 1 for the reference, more for a slow agent."""
    ours = load_suite("interdrive@0")[TOWN]
    assert not isinstance(ours, Suite)
    alone = ours.model_copy(update={"egos": ours.egos[:1]})
    save_suite(Suite(SuiteFile(name="mine", title=""), tmp_path / "mine", (alone,)))
    options = ("--suite", tmp_path / "mine", "--workers", 1)
    drive = ("eval", *options, *REFERENCE, "--out", tmp_path / "ref")
    assert "times        none for 1 scenarios: `mdrive-sumo validate SUITE --write`" in command(*drive).output
    assert load_results(tmp_path / "ref" / "results.json").scenarios[0].time_ratio is None
    told = command("reference-times", tmp_path / "ref")
    assert (told.exit_code, told.output) == (0, f"{tmp_path / 'mine' / REFERENCE_TIMES_FILE}  times of 1 scenarios\n")
    assert "times  " not in command(*drive).output  # nothing is driven again
    (again,) = load_results(tmp_path / "ref" / "results.json").scenarios
    assert (again.time_ratio, again.efficient_sr) == (1.0, 100.0)
    command("eval", *options, "--agent", "constant-speed", "--agent-config", slow(tmp_path), "--out", tmp_path / "slow")
    (found,) = load_results(tmp_path / "slow" / "results.json").scenarios
    assert found.egos[0].ticks is not None and again.egos[0].ticks is not None and found.time_ratio is not None
    assert found.time_ratio == round(found.egos[0].ticks / again.egos[0].ticks, 6)
    assert (found.sr, found.efficient_sr) == (100.0, 0.0)
    rescored = command("rescore", tmp_path / "slow")
    assert rescored.exit_code == 0, rescored.output
    assert load_results(tmp_path / "slow" / "results-mdrive.json").scenarios[0] == found


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of `omniscient` without a simulation."""
    folder = tmp_path_factory.mktemp("finished")
    suite_fakes.make_suite(folder / "suite", "answer")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mdrive_sumo.runs.evaluate.run_job", suite_fakes.drive)
        options = ("--suite", folder / "suite", *REFERENCE, "--workers", 1, "--out", folder / "run")
        assert command("eval", *options).exit_code == 0
    return folder / "run"


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"agent": "idm"}, "agent: expected a run with 'omniscient', found 'idm'"),
        ({"agent_config": '{"speed":5}'}, "agent_config: expected a run with '{}'"),
        ({"seed": 1}, "seed: expected a run with 0, found 1"),
        ({"agent_clock": "fixed:100"}, "agent_clock: expected a run with 'ideal', found 'fixed:100'"),
        ({"actors": "original"}, "actors: expected a run with 'default', found 'original'"),
        ({"friction": "weather"}, "friction: expected a run with 'dry', found 'weather'"),
        ({"ids": "random"}, "ids: expected a run with 'scenario', found 'random'"),
        ({"sensing": "realistic"}, "sensing: expected a run with 'perfect', found 'realistic'"),
    ],
)
def test_a_run_that_is_no_reference_is_exit_code_2(finished: Path, changes: dict[str, object], says: str) -> None:
    journal = finished / "journal.jsonl"
    kept = journal.read_text()

    def change(line: str) -> str:
        values = json.loads(line)
        if "fingerprint" in values:
            values["fingerprint"] |= changes
        return json.dumps(values)

    try:
        rewrite_journal(journal, change)
        told = command("reference-times", finished)
    finally:
        journal.write_text(kept)
    assert told.exit_code == 2
    assert says in told.output
    assert not (finished.parent / "suite" / REFERENCE_TIMES_FILE).exists()


def test_a_folder_without_a_run_is_exit_code_2(tmp_path: Path) -> None:
    told = command("reference-times", tmp_path)
    assert told.exit_code == 2
    assert "expected a folder that `mdrive-sumo eval` has written" in told.output
