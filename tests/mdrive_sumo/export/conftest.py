"""Shared by the tests of exports: one driven episode, and its recording."""

from collections.abc import Callable
from pathlib import Path

import pytest
from testing.local_executor import run_in_process
from testing.mixed_run import SCENARIO, drive_mixed_run

from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.export.export_run import export_runs, load_recordings, select_recorded
from mdrive_sumo.export.scored_recording import ScoredRecording
from mdrive_sumo.runs.stored_run import StoredRun, load_stored_run

Export = Callable[[str], Path]


@pytest.fixture(scope="session")
def run_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with pytest.MonkeyPatch.context() as patch:
        run_in_process(patch)
        return drive_mixed_run(tmp_path_factory.mktemp("mixed"))


@pytest.fixture(scope="session")
def stored(run_folder: Path) -> StoredRun:
    return load_stored_run(run_folder)


@pytest.fixture(scope="session")
def recording(stored: StoredRun) -> ScoredRecording:
    (found,) = load_recordings(stored, select_recorded(stored))
    assert found.scenario.id == SCENARIO
    return found


@pytest.fixture(scope="session")
def record(recording: ScoredRecording) -> EpisodeRecord:
    return recording.record


@pytest.fixture(scope="session")
def exported(stored: StoredRun, tmp_path_factory: pytest.TempPathFactory) -> Export:
    """Return the folder with the run in a format, written once."""
    folders: dict[str, Path] = {}

    def export(name: str) -> Path:
        if name not in folders:
            folders[name] = export_runs([stored], name, tmp_path_factory.mktemp(name) / "out")
        return folders[name]

    return export
