"""Collect the situations of many training scenarios in worker processes; an interrupted collection goes on.

What is in a file depends on the settings and the index of its scenario only.
"""

import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.input_files import read_json_file
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.learning.collection import CollectionProgress, FileCollection
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.dialogue.drive_situations import SituationSampling, drive_situations
from mdrive_sumo.learning.dialogue.situations import Situation, write_situations
from mdrive_sumo.learning.sample_format import SPLITS, CollectedScenario
from mdrive_sumo.learning.scenario_jobs import ScenarioJob, WaitingScenario
from mdrive_sumo.negotiation.dialogue.answers import MAX_MEMBERS

FORMAT = "mdrive-sumo situations 1"
INDEX_NAME, FILE_NAME = "situations.json", "situations-{:06d}.json.gz"
LEAST_CAVS = 2
"""Scenarios with fewer are not driven."""


class SituationFile(WaitingScenario):
    """A finished scenario and its file, if it has situations; `samples` are situations."""

    members: tuple[int, ...] = (0,) * (MAX_MEMBERS - 1)
    """Situations with two members, with three, ..."""
    searched: int = 0
    """Situations with simulated orders."""
    better: int = 0
    """Of these, those whose best order is not that of `passing`."""


def collect_situations(
    settings: CollectionSettings,
    sampling: SituationSampling,
    folder: Path,
    scenarios: int,
    workers: int,
    progress: CollectionProgress,
    fresh: bool,
) -> list[SituationFile]:
    """Make what is missing of the situations of so many scenarios; return what there is, by index.

    See `FileCollection.collect`. Raises InputError.
    """
    return FileCollection(
        settings,
        {**settings.fingerprint, "collection": FORMAT, **asdict(sampling)},
        partial(run_situation_job, sampling),
        SituationFile,
        folder,
        FILE_NAME,
        (FILE_NAME.replace("{:06d}", "*"),),
        partial(_write_index, folder, settings.split),
    ).collect(scenarios, workers, progress, fresh)


def run_situation_job(sampling: SituationSampling, job: ScenarioJob) -> SituationFile:
    """Drive a scenario and write its situations. Raises InputError and OSError."""
    chosen = job.settings.load_scenario(job.index)
    if chosen is None or len(chosen[0].egos) < LEAST_CAVS:
        about = CollectedScenario(index=job.index, status="none", scenario=chosen[0].id if chosen else "")
        return SituationFile(scenario=about, bytes=0, checksum="")
    scenario, roads = chosen
    try:
        found = drive_situations(job.settings, scenario, roads, job.settings.derive_episode_seed(job.index), sampling)
    except WorldError as error:
        failed = CollectedScenario(index=job.index, status="failed", scenario=scenario.id, reason=str(error))
        return SituationFile(scenario=failed, bytes=0, checksum="")
    done = CollectedScenario(index=job.index, status="done", scenario=scenario.id, samples=len(found))
    if not found:
        return SituationFile(scenario=done, bytes=0, checksum="")
    size = write_situations(job.path, found)
    searched = [one for one in found if one.outcomes]
    return SituationFile(
        scenario=done,
        bytes=size,
        checksum=compute_file_checksum(job.path),
        members=_count_members(found),
        searched=len(searched),
        better=sum(one.choose_order() != one.orders["passing"] for one in searched),
    )


def _count_members(situations: Sequence[Situation]) -> tuple[int, ...]:
    sizes = [len(situation.letters) for situation in situations]
    return tuple(sizes.count(size) for size in range(2, MAX_MEMBERS + 1))


def _write_index(folder: Path, split: str, found: Sequence[SituationFile]) -> None:
    names = [FILE_NAME.format(entry.scenario.index) for entry in found if entry.scenario.samples]
    write_text(folder / INDEX_NAME, json.dumps({"format": FORMAT, "split": split, "files": names}, indent=1) + "\n")


def list_situation_files(folder: Path) -> tuple[str, list[Path]]:
    """Return the split and the files of a collection. Raises InputError for a folder that holds none."""
    path = folder / INDEX_NAME
    index = read_json_file(path, "the index of situations", FORMAT)
    if index.get("split") not in SPLITS:
        raise InputError(f"{path}: split: expected one of {', '.join(SPLITS)}, found {index.get('split')!r:.60}")
    names = index.get("files")
    if not isinstance(names, list) or not names:
        raise InputError(f"{path}: files: expected names of one file or more, found {names!r:.60}")
    for name in names:
        if not isinstance(name, str) or Path(name).name != name:
            raise InputError(f"{path}: files: expected names of files in the same folder, found {name!r:.60}")
    return index["split"], [folder / name for name in names]
