"""A small data set, made in the test's own process, and drives with their recordings. No tests in here."""

import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from mdrive_sumo.learning.collection import collect_dataset
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.drive_episode import CollectedDrive, drive_scenario
from mdrive_sumo.learning.sample_format import CollectedScenario, DatasetFile, ShardEntry
from testing.local_executor import LocalExecutor
from testing.short_suite import make_short_suite

SCENARIOS = ("i12*", "i24*")
METRES = 40
SETTINGS = CollectionSettings("train", 3, "omniscient", perturbation=2.0)


class SilentProgress:
    """A `CollectionProgress` that keeps its notes."""

    def __init__(self) -> None:
        self.notes: list[str] = []
        self.kept = self.waiting = 0
        self.driven: list[int] = []
        self.made: list[str] = []

    def begin(self, total: int, kept: int, waiting: int = 0) -> None:
        del total
        self.kept, self.waiting = kept, waiting

    def finish_scenario(self, scenario: CollectedScenario) -> None:
        self.driven.append(scenario.index)

    def finish_shard(self, entry: ShardEntry) -> None:
        self.made.append(entry.name)

    def note(self, text: str) -> None:
        self.notes.append(text)


def make_settings(suite: Path, **changes: object) -> CollectionSettings:
    """Return settings for the scenarios of a suite."""
    return replace(SETTINGS, suite=str(suite), **changes)  # type: ignore[arg-type]


def make_suite(folder: Path) -> Path:
    """Save a suite of two short scenarios with several CAVs each."""
    return make_short_suite(folder, *SCENARIOS, metres=METRES)


def collect_here(
    settings: CollectionSettings, folder: Path, scenarios: int = 2, fresh: bool = False
) -> tuple[DatasetFile, SilentProgress]:
    """Make a data set in this process."""
    progress = SilentProgress()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mdrive_sumo.learning.collection.make_executor", LocalExecutor)
        return collect_dataset(settings, folder, scenarios, 1, progress, fresh), progress


def drive_here(settings: CollectionSettings, index: int = 0) -> CollectedDrive:
    """Drive one scenario of the settings' suite."""
    found = settings.load_scenario(index)
    assert found is not None
    return drive_scenario(settings, *found, settings.derive_episode_seed(index))


def copy_dataset(source: Path, target: Path) -> Path:
    """Return a copy of a data set that a test may damage."""
    shutil.copytree(source, target)
    return target
