"""`mdrive-sumo explain`, from a run to sentences, and the notes that it reads: outside of digests and scores."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner, Result
from testing.local_executor import run_in_process
from testing.mixed_run import SCENARIO, drive_mixed_run
from testing.short_suite import make_short_suite

from mdrive_sumo.agents.sharing import SingleAgent
from mdrive_sumo.cli import main
from mdrive_sumo.contract import REASON, Cause, Note, Observation, Reason, Reply
from mdrive_sumo.episode import EpisodeRecord, load_episode
from mdrive_sumo.scoring import ScenarioResult, load_results

pytestmark = pytest.mark.slow

CROSSING = "i25_ins_oppo_boulevard"


def call(*words: object) -> Result:
    return CliRunner().invoke(main, [str(word) for word in words])


@pytest.fixture(scope="module", autouse=True)
def in_process() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        yield


def drive(folder: Path, suite: Path, *options: object) -> Path:
    done = call("eval", "--suite", suite, "--agent", "single", "--workers", 1, "--out", folder, *options)
    assert done.exit_code == 0, done.output
    return folder


@pytest.fixture(scope="module")
def suite(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return make_short_suite(tmp_path_factory.mktemp("explain") / "suite", CROSSING, metres=50)


@pytest.fixture(scope="module")
def run(suite: Path) -> Path:
    return drive(suite.parent / "run", suite)


def explain(run: Path, *words: object) -> list[str]:
    done = call("explain", run, "--scenario", "i25*", *words)
    assert done.exit_code == 0, done.output
    return done.output.splitlines()


def test_the_story_names_the_cav_that_one_yields_to(run: Path) -> None:
    head, *lines = explain(run, "--cav", "0")
    assert head.startswith(f"CAV 0 of {CROSSING} (agent single, seed 0): ")
    assert lines[0] == "   0.0 s  departs: drives towards a bend 29 m ahead that allows 6.6 m/s"
    assert any("brakes from" in line and "yields to CAV 1, which crosses in" in line for line in lines)
    assert lines[-1].endswith("s  arrives")
    times = [float(line.split(" s ")[0]) for line in lines]
    assert times == sorted(times)


def test_every_cav_of_the_first_scenario_is_told_of_unless_one_is_named(run: Path) -> None:
    done = call("explain", run)
    heads = [line.split(" of ")[0] for line in done.output.splitlines() if line.startswith("CAV ")]
    assert done.exit_code == 0 and heads == ["CAV 0", "CAV 1", "CAV 2", "CAV 3"]
    assert explain(run, "--cav", "0") == done.output.splitlines()[: len(explain(run, "--cav", "0"))]


def test_a_tick_says_what_holds(run: Path) -> None:
    now, why, *_ = explain(run, "--cav", "0", "--tick", 82)
    assert now.startswith("At tick 82 (4.1 s) CAV 0 brakes at ")
    assert why.startswith("Why, noted at 3.9 s (tick 78): it yields to CAV 1, which crosses in ")


@pytest.mark.parametrize(
    ("words", "sentence"),
    [
        (("--scenario", "i25*", "--cav", "9"), f"--cav: expected a CAV of {CROSSING} (0, 1, 2, 3), found '9'"),
        (("--scenario", "i25*", "--cav", "0", "--tick", "-1"), "--tick: expected 0 to "),
        (("--scenario", "i25*", "--cav", "0", "--tick", "99999"), f"the ticks of {CROSSING}, found 99999"),
        (("--scenario", "i25*", "--cav", "0", "--tick", "soon"), "'soon' is not a valid integer"),
        (("--scenario", "i25*", "--cav", "0", "--seed", "7"), "--seed: expected one of the run's, 0, found 7"),
        (("--scenario", "i99", "--cav", "0"), "expected"),
    ],
)
def test_a_mistake_is_one_sentence(run: Path, words: tuple[str, ...], sentence: str) -> None:
    done = call("explain", run, *words)
    assert done.exit_code == 2 and sentence in done.stderr
    assert "Traceback" not in done.output


def test_a_folder_that_is_no_run_is_one_sentence(tmp_path: Path) -> None:
    done = call("explain", tmp_path, "--scenario", "a", "--cav", "0")
    assert done.exit_code == 2 and done.stderr.startswith("Error: ") and "expected" in done.stderr


def test_an_agent_that_notes_nothing_leaves_what_the_recording_shows(tmp_path: Path) -> None:
    done = call("explain", drive_mixed_run(tmp_path), "--scenario", SCENARIO, "--cav", "1")
    assert done.exit_code == 0, done.output
    assert "Its agent noted no reasons, so this is only what the recording shows." in done.output
    assert "departs" in done.output


def test_reasons_change_no_digest_and_no_score(run: Path, suite: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Silent(SingleAgent):
        def act(self, seen: Observation) -> Reply:
            return replace(super().act(seen), notes=())

    for module in ("runs.open_agents", "runs.agent_spec"):
        monkeypatch.setattr(f"mdrive_sumo.{module}.AGENTS", {"single": Silent})
    silent = drive(suite.parent / "silent", suite)
    (told, silently), (noted, quiet) = zip(*map(read, (run, silent)), strict=True)
    assert told.model_copy(update={"digest": ""}) == silently.model_copy(update={"digest": ""})
    assert told.digest == silently.digest and (noted.digests == quiet.digests).all()
    assert told.notes == {}  # no events: every drive has them
    assert not quiet.notes and {record.note.kind for record in noted.notes} == {REASON}


def test_no_note_of_an_agent_stops_a_reader_or_forges_a_line(
    suite: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """As found: an integer of 400 digits was a traceback of every reader, and a name with a line break was a line."""
    huge = Note(REASON, '{"cause":"yield","distance_m":1' + "0" * 400 + "}")
    forged = Reason(Cause.YIELD, ("van\n   9.9 s  arrives\r\x1b[2K",)).to_note()

    class Forger(SingleAgent):
        def act(self, seen: Observation) -> Reply:
            return replace(super().act(seen), notes=(huge, forged) if seen.tick % 20 == 0 else ())

    for module in ("runs.open_agents", "runs.agent_spec"):
        monkeypatch.setattr(f"mdrive_sumo.{module}.AGENTS", {"single": Forger})
    run = drive(tmp_path / "run", suite)
    assert all(not line.startswith("   9.9 s  arrives") and "\x1b" not in line for line in explain(run, "--cav", "0"))
    assert any("van 9.9 s arrives" in line for line in explain(run, "--cav", "0", "--tick", 82))
    done = call("view", run, "--no-open")
    assert done.exit_code == 0, done.output


def read(run: Path) -> tuple[ScenarioResult, EpisodeRecord]:
    (path,) = run.glob("episodes/*.npz")
    return load_results(run / "results.json").scenarios[0], load_episode(path)


def test_the_page_of_the_run_tells_the_reason_of_a_loss(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[Any] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    done = call("view", run, "--no-open")
    assert done.exit_code == 0, done.output
    page = (run / "view" / "index.html").read_text()
    assert "hit CAV 3 at " in page and "(noted: finds no way past CAV 3)" in page
