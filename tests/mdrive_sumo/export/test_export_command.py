"""`mdrive-sumo export` and the front door: what they write, and one clear sentence for what they cannot."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from click.testing import CliRunner, Result
from testing.mixed_run import SCENARIO, drive_mixed_run

import mdrive_sumo as md
from mdrive_sumo.cli import main
from mdrive_sumo.export import export_formats
from mdrive_sumo.export.export_formats import EXPORT_FORMATS, ExportFormat
from mdrive_sumo.export.export_run import export_runs, load_recordings, select_recorded
from mdrive_sumo.runs.stored_run import StoredRun

pytestmark = pytest.mark.slow  # of an episode that is driven

BASE_INSTALL = {"csv", "fcd", "scenarionet"}
"""Formats that need no extra."""


def call(*words: object) -> Result:
    return CliRunner().invoke(main, ["export", *(str(word) for word in words)])


def test_the_command_writes_and_lists_files(run_folder: Path, tmp_path: Path) -> None:
    done = call(run_folder, "--format", "fcd", "--scenario", "mix*", "--out", tmp_path / "out")
    assert done.exit_code == 0, done.output
    names = ["main_street.net.xml.gz", f"{SCENARIO}.fcd.xml", f"{SCENARIO}.types.xml"]
    assert done.output.splitlines() == [str(tmp_path / "out" / name) for name in names]


def test_the_front_door_exports_runs_and_episodes(run_folder: Path, tmp_path: Path) -> None:
    run = md.load_run(run_folder)
    states = [
        (folder / "states.csv").read_bytes()
        for folder in (
            run.export("csv", tmp_path / "run"),
            run.episode(SCENARIO).export("csv", tmp_path / "episode"),
        )
    ]
    assert states[0] == states[1]


def with_results(stored: StoredRun, seed: int = 0, **changes: object) -> StoredRun:
    """Return the run with another seed and changed results of its scenario."""
    results = stored.results
    scenarios = tuple(one.model_copy(update=changes) for one in results.scenarios)
    info = results.run.model_copy(update={"seed": seed})
    return replace(stored, results=results.model_copy(update={"run": info, "scenarios": scenarios}))


def test_each_seed_of_a_run_gets_a_folder(stored: StoredRun, tmp_path: Path) -> None:
    out = export_runs([stored, with_results(stored, seed=3)], "fcd", tmp_path / "out")
    assert sorted(path.name for path in out.iterdir()) == ["seed0", "seed3"]
    with pytest.raises(md.InputError, match="cannot be written: File exists"):
        export_runs([stored, stored], "fcd", tmp_path / "twice")
    assert not (tmp_path / "twice").exists()


def test_files_of_a_run_with_several_seeds_say_which(stored: StoredRun) -> None:
    (result,) = stored.results.scenarios
    found = load_recordings(stored, [result, result.model_copy(update={"seed": 3})])
    assert [one.name for one in found] == [f"{SCENARIO}_seed0", f"{SCENARIO}_seed3"]


def test_void_scenarios_have_nothing_to_export(stored: StoredRun) -> None:
    with pytest.raises(
        md.InputError, match=r"at least one recorded episode, found 1 void scenarios \(mixed: SUMO died"
    ):
        select_recorded(with_results(stored, status="void", reason="SUMO died"))


BAD_WORDS = [
    (("--scenario", "mixd"), "its 1 scenarios, found 'mixd'; did you mean 'mixed'?"),
    (("--scenario", "zzz"), "its 1 scenarios, found 'zzz'; the first is mixed"),
    (("--format", "rosbag"), "rosbag"),
]


@pytest.mark.parametrize(("words", "sentence"), BAD_WORDS)
def test_bad_options_get_one_sentence(run_folder: Path, tmp_path: Path, words: tuple[str, ...], sentence: str) -> None:
    usual = () if "--format" in words else ("--format", "csv")
    done = call(run_folder, "--out", tmp_path / "out", *usual, *words)
    assert done.exit_code == 2 and sentence in done.stderr
    assert not (tmp_path / "out").exists()


def test_what_is_there_is_not_overwritten(run_folder: Path, tmp_path: Path) -> None:
    (tmp_path / "mine.txt").write_text("keep me")
    done = call(run_folder, "--format", "csv", "--out", tmp_path)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "expected a new or empty folder to write to" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_a_folder_that_is_no_run_is_refused(tmp_path: Path) -> None:
    done = call(tmp_path, "--format", "csv", "--out", tmp_path / "out")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert str(tmp_path) in done.stderr


def copy_run(run_folder: Path, folder: Path) -> Path:
    for file in run_folder.rglob("*"):
        if file.is_file():
            target = folder / file.relative_to(run_folder)
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes(file.read_bytes())
    return folder


def test_a_missing_or_changed_recording_is_named(run_folder: Path, tmp_path: Path) -> None:
    copy = copy_run(run_folder, run_folder.with_name(f"{tmp_path.name}-copy"))  # beside its suite
    recording = copy / "episodes" / f"{SCENARIO}.npz"
    recording.write_bytes(recording.read_bytes() + b"x")
    assert "it was changed or damaged" in call(copy, "--format", "csv", "--out", tmp_path / "out").stderr
    recording.unlink()
    done = call(copy, "--format", "csv", "--out", tmp_path / "out")
    assert done.exit_code == 2 and f"{recording}: cannot be read" in done.stderr


def test_a_run_without_recordings_says_how_to_get_them(in_process: None, tmp_path: Path) -> None:
    run = drive_mixed_run(tmp_path, "--no-record")
    done = call(run, "--format", "csv", "--out", tmp_path / "out")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "made with --no-record; `mdrive-sumo eval` without that option keeps them" in done.stderr


def test_an_empty_run_is_refused(run_folder: Path, tmp_path: Path) -> None:
    copy = copy_run(run_folder, tmp_path / "copy")
    results = json.loads((copy / "results.json").read_text())
    (copy / "results.json").write_text(json.dumps(results | {"scenarios": []}))
    done = call(copy, "--format", "csv", "--out", tmp_path / "out")
    assert done.exit_code == 2 and "expected at least one, found none" in done.stderr


@pytest.mark.parametrize("name", sorted(EXPORT_FORMATS))
def test_a_missing_extra_is_named(name: str, run_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """As in the base install, which has none of the packages of the extra."""
    monkeypatch.setattr("importlib.util.find_spec", lambda module: None)
    if name in BASE_INSTALL:
        assert not EXPORT_FORMATS[name].package
        return
    done = call(run_folder, "--format", name, "--out", tmp_path / "out")
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert f"{EXPORT_FORMATS[name].package}, found none: pip install '.[export]'" in done.stderr


def write_ids(recordings: object, folder: Path) -> None:
    ids = [one.scenario.id for one in recordings]  # type: ignore[attr-defined]
    (folder / "ids.txt").write_text("\n".join(ids))


def test_a_row_in_the_table_is_a_format(run_folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    row = ExportFormat("ids", f"{__name__}:write_ids")
    monkeypatch.setitem(export_formats.EXPORT_FORMATS, "ids", row)  # type: ignore[arg-type]
    monkeypatch.setattr("importlib.import_module", lambda module: __import__("sys").modules[module])
    assert (md.load_run(run_folder).export("ids", tmp_path / "out") / "ids.txt").read_text() == SCENARIO
