"""Make a data set: every few scenarios become one shard, in worker processes; an interrupted collection goes on.

What is in a shard depends on the settings and the indices of its scenarios only, never on the number of workers.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from pydantic import ValidationError

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import remove_parts, write_text
from mdrive_sumo.core.version import __version__
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.drive_episode import collect_scenario
from mdrive_sumo.learning.sample_files import SampleFiles, write_shard
from mdrive_sumo.learning.sample_format import DATASET_FILE, SHARD_SCENARIOS, CollectedScenario, DatasetFile, ShardEntry
from mdrive_sumo.learning.shard_reading import load_dataset_file
from mdrive_sumo.runs.executor import run_jobs
from mdrive_sumo.runs.journal import Journal, open_journal
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.runs.worker_process import FailureKind, WorkerFailure, describe_write_error
from mdrive_sumo.scenario.scenario import describe_first_error

SHARD_LIMIT_S = 7200.0
"""Wall clock of one shard: it ends what hangs, and must not end what only waits for a busy machine."""


class CollectionProgress(Protocol):
    """Receives the progress of a collection."""

    def begin(self, total: int, kept: int) -> None:
        """The work begins: the number of shards, and how many of them are there already."""
        ...

    def finish_shard(self, entry: ShardEntry) -> None:
        """A shard was written."""
        ...

    def note(self, text: str) -> None:
        """A message for the user."""
        ...


@dataclass(frozen=True, slots=True)
class ShardJob:
    """One shard to make."""

    settings: CollectionSettings
    folder: Path
    number: int
    indices: tuple[int, ...]
    """Indices of its scenarios."""

    @property
    def name(self) -> str:
        """Name of its file."""
        return format_shard_name(self.number)


def format_shard_name(number: int) -> str:
    """Return the file name of a shard."""
    return f"shard-{number:06d}.tar"


def make_shard(job: ShardJob) -> ShardEntry:
    """Drive the scenarios of a shard and write it. Raises InputError and OSError."""
    scenarios: list[CollectedScenario] = []
    size, checksum = write_shard(job.folder / job.name, _collect_samples(job, scenarios))
    samples = sum(scenario.samples for scenario in scenarios)
    return ShardEntry(name=job.name, samples=samples, bytes=size, checksum=checksum, scenarios=tuple(scenarios))


def _collect_samples(job: ShardJob, scenarios: list[CollectedScenario]) -> Iterator[SampleFiles]:
    """Yield the samples of a shard; append what became of each scenario. One scenario is in memory at a time."""
    for index in job.indices:
        scenario, samples = collect_scenario(job.settings, index)
        scenarios.append(scenario)
        yield from samples


def collect_dataset(
    settings: CollectionSettings, folder: Path, scenarios: int, workers: int, progress: CollectionProgress, fresh: bool
) -> DatasetFile:
    """Make what is missing of a data set of so many scenarios and return its description.

    A shard that the journal does not know, or whose file is not the one that it knows, is made again. Raises
    InputError, also for a folder that holds another data set.
    """
    jobs = _list_jobs(settings, folder, scenarios)
    with open_journal(folder, settings.fingerprint, fresh=fresh) as journal:
        if journal.torn:
            progress.note("the last line of the journal was incomplete and has been dropped")
        remove_parts(folder)
        if fresh:
            _remove_left_files(folder, "shard-*.tar")
        kept = _find_kept(journal, jobs, progress)
        progress.begin(len(jobs), len(kept))
        entries = dict(kept)
        dataset = _write_dataset(settings, folder, scenarios, entries)
        for entry in _make_shards([job for job in jobs if job.name not in kept], workers, journal, progress):
            entries[entry.name] = entry
            dataset = _write_dataset(settings, folder, scenarios, entries)
            progress.finish_shard(entry)
    return dataset


def _list_jobs(settings: CollectionSettings, folder: Path, scenarios: int) -> list[ShardJob]:
    return [
        ShardJob(
            settings,
            folder.resolve(),
            first // SHARD_SCENARIOS,
            tuple(range(first, min(first + SHARD_SCENARIOS, scenarios))),
        )
        for first in range(0, scenarios, SHARD_SCENARIOS)
    ]


def _remove_left_files(folder: Path, pattern: str) -> None:
    """Remove files of earlier starts; nothing else works in a locked folder."""
    for path in folder.glob(pattern):
        path.unlink()


def _find_kept(journal: Journal, jobs: Sequence[ShardJob], progress: CollectionProgress) -> dict[str, ShardEntry]:
    """Return the shards that need not be made: noted with all their scenarios, and still the file that was noted."""
    noted = {entry.name: entry for entry in _read_entries(journal)}
    kept: dict[str, ShardEntry] = {}
    for job in jobs:
        entry = noted.get(job.name)
        if entry is None or not set(job.indices) <= {one.index for one in entry.scenarios if one.status != "failed"}:
            continue
        path = job.folder / job.name
        if path.is_file() and path.stat().st_size == entry.bytes and compute_file_checksum(path) == entry.checksum:
            kept[job.name] = entry
        else:
            progress.note(f"{path}: expected the shard that was written, found another file or none; it is made again")
    return kept


def _read_entries(journal: Journal) -> Iterator[ShardEntry]:
    for line in journal.results:
        try:
            yield ShardEntry.model_validate(line["shard"])
        except (ValidationError, KeyError) as error:
            what = describe_first_error(error) if isinstance(error, ValidationError) else "expected a shard"
            raise InputError(f"{journal.path}: {line['id']!r:.80}: {what}; --fresh starts anew") from None


def _make_shards(
    jobs: Sequence[ShardJob], workers: int, journal: Journal, progress: CollectionProgress
) -> Iterator[ShardEntry]:
    """Make shards in worker processes and note each. Raises InputError for what the user has to correct."""
    with make_executor(make_shard, workers, SHARD_LIMIT_S) as executor:
        for job, outcome in run_jobs(executor, jobs):
            if isinstance(outcome, WorkerFailure):
                if outcome.kind is FailureKind.INPUT:
                    raise InputError(outcome.reason)
                journal.add_failure(job.name, outcome.reason)
                progress.note(f"{job.name}: {outcome.reason}; the same command tries it again")
                continue
            journal.add_result({"id": outcome.name, "shard": outcome.model_dump(mode="json")}, outcome.checksum)
            yield outcome


def _write_dataset(
    settings: CollectionSettings, folder: Path, scenarios: int, entries: Mapping[str, ShardEntry]
) -> DatasetFile:
    """Write `dataset.json`, whole or not at all."""
    shards = tuple(entry for _, entry in sorted(entries.items()))
    dataset = DatasetFile(
        program=__version__,
        split=settings.split,
        seed=settings.seed,
        expert=settings.expert,
        rigs=settings.rigs,
        perturbation=settings.perturbation,
        driver=settings.driver_checksum,
        mix=settings.mix,
        round=settings.round,
        suite=settings.suite,
        requested=scenarios,
        samples=sum(shard.samples for shard in shards),
        shards=shards,
    )
    path = folder / DATASET_FILE
    try:
        write_text(path, dataset.model_dump_json(indent=1) + "\n")
    except OSError as error:
        raise InputError(describe_write_error(error, path)) from None
    return dataset


EXPERT_SHARE = 0.2
"""Share of the segments of a drive that the expert drives, as `learn data --mix`."""


@dataclass(frozen=True, slots=True)
class RoundPlan:
    """How much each round drives, and as what."""

    first: Path
    """Data set whose split, seed, expert, rigs and perturbation are used again."""
    scenarios: int
    workers: int


def collect_round(plan: RoundPlan, round_: int, weights: Path, folder: Path, progress: CollectionProgress) -> None:
    """Let weights (.onnx) drive the scenarios of a round and write the samples into a folder. Raises InputError."""
    made = load_dataset_file(plan.first)
    settings = CollectionSettings(
        split=made.split,
        seed=made.seed,
        expert=made.expert,
        rigs=made.rigs,
        perturbation=made.perturbation,
        driver=weights.resolve(),
        mix=EXPERT_SHARE,
        round=round_,
        suite=made.suite,
    )
    collect_dataset(settings, folder, plan.scenarios, plan.workers, progress, fresh=False)
