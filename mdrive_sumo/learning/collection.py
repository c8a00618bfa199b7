"""Make a data set: scenarios are driven in worker processes and packed into shards; an interrupted collection goes on.

What is in a shard depends on the settings and the indices of its scenarios only, never on the number of workers or on
the order in which scenarios finish.
"""

from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Generic, Protocol, TypeVar

from pydantic import BaseModel, ValidationError

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder, remove_parts, write_text
from mdrive_sumo.core.version import __version__
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.sample_files import read_members, write_shard
from mdrive_sumo.learning.sample_format import DATASET_FILE, SHARD_SCENARIOS, CollectedScenario, DatasetFile, ShardEntry
from mdrive_sumo.learning.scenario_jobs import ScenarioJob, WaitingScenario, order_jobs, run_scenario_job
from mdrive_sumo.learning.shard_reading import load_dataset_file
from mdrive_sumo.runs.executor import run_jobs
from mdrive_sumo.runs.journal import Fingerprint, Journal, open_journal
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.runs.worker_process import FailureKind, WorkerFailure, describe_write_error
from mdrive_sumo.scenario.scenario import describe_first_error

SCENARIO_LIMIT_S = 1800.0
"""Wall clock of one scenario: it ends what hangs, and must not end what only waits for a busy machine."""
WAITING_FOLDER = "waiting"
"""Folder in that of the data set: the samples of finished scenarios until their shard is packed."""
TORN = "the last line of the journal was incomplete and has been dropped"


class CollectionProgress(Protocol):
    """Receives the progress of a collection."""

    def begin(self, total: int, kept: int, waiting: int = 0) -> None:
        """The work begins: the number of shards, how many are there already, and finished scenarios of other shards."""
        ...

    def finish_scenario(self, scenario: CollectedScenario) -> None:
        """A scenario was driven."""
        ...

    def finish_shard(self, entry: ShardEntry) -> None:
        """A shard was written."""
        ...

    def note(self, text: str) -> None:
        """A message for the user."""
        ...


Entry = TypeVar("Entry", bound=WaitingScenario)


@dataclass
class ScenarioFiles(Generic[Entry]):
    """The files of finished scenarios, one each in one folder, which a journal knows; those that lack are driven.

    Nothing else works in the folder. Methods raise OSError for it.
    """

    settings: CollectionSettings
    run: Callable[[ScenarioJob], Entry]
    """Drives a scenario and writes its file, in a worker process."""
    entry_type: type[Entry]
    folder: Path
    name: str
    """Name of a file, with a place for the index of its scenario."""
    journal: Journal
    progress: CollectionProgress
    entries: dict[int, Entry] = field(default_factory=dict[int, Entry])
    """The finished scenarios, by index."""

    def find_file(self, index: int) -> Path:
        """Return the path of the file of a scenario."""
        return self.folder / self.name.format(index)

    def find_kept(self, indices: Iterable[int]) -> None:
        """Find which of the scenarios need not be driven again. Raises InputError."""
        noted = {entry.scenario.index: entry for entry in read_noted(self.journal, "waiting", self.entry_type)}
        self.entries |= {index: noted[index] for index in indices if index in noted and self._is_kept(noted[index])}

    def _is_kept(self, entry: Entry) -> bool:
        """Return whether the file of a finished scenario is there; that of a packed one is not."""
        path = self.find_file(entry.scenario.index)
        if entry.scenario.status == "failed" or not (path.is_file() or entry.bytes == 0):
            return False
        if entry.bytes == 0 or is_as_noted(path, entry):
            return True
        self.progress.note(f"{path}: expected the samples that were written, found others; they are made again")
        return False

    def drive(self, indices: Iterable[int], scenarios: int, workers: int) -> Iterator[Entry]:
        """Drive scenarios and yield the entry of each when it is finished; scenarios: of all that places are drawn for.

        Raises InputError for what the user has to correct.
        """
        jobs = [ScenarioJob(self.settings, self.find_file(index), index) for index in indices]
        if jobs:
            self.settings.draw_places(scenarios, workers, self.progress.note)
        with make_executor(self.run, workers, SCENARIO_LIMIT_S) as executor:
            for job, outcome in run_jobs(executor, order_jobs(jobs, workers)):
                entry = self.entries[job.index] = self._note(job, outcome)
                self.progress.finish_scenario(entry.scenario)
                yield entry

    def _note(self, job: ScenarioJob, outcome: Entry | WorkerFailure) -> Entry:
        """Note what became of a scenario. Raises InputError for what the user has to correct."""
        name = job.path.stem
        if not isinstance(outcome, WorkerFailure):
            self.journal.add_result({"id": name, "waiting": outcome.model_dump(mode="json")}, outcome.checksum)
            return outcome
        if outcome.kind is FailureKind.INPUT:
            raise InputError(outcome.reason)
        self.journal.add_failure(name, outcome.reason)
        self.progress.note(f"{name}: {outcome.reason}; the same command tries it again")
        failed = CollectedScenario(index=job.index, status="failed", reason=outcome.reason)
        return self.entry_type(scenario=failed, bytes=0, checksum="")


@dataclass(frozen=True, slots=True)
class FileCollection(Generic[Entry]):
    """A collection that keeps a file for each scenario, and an index of them, but no shards."""

    settings: CollectionSettings
    fingerprint: Fingerprint
    """What makes two collections the same."""
    run: Callable[[ScenarioJob], Entry]
    entry_type: type[Entry]
    folder: Path
    name: str
    """Name of a file, with a place for the index of its scenario."""
    patterns: tuple[str, ...]
    """Globs of all files that `run` writes."""
    write_index: Callable[[list[Entry]], None]
    """Gets the finished scenarios by index, also after an interruption."""

    def collect(self, scenarios: int, workers: int, progress: CollectionProgress, fresh: bool) -> list[Entry]:
        """Make what is missing of so many scenarios and return what there is, by index.

        A file that the journal does not know, or that is not the one that it knows, is made again. Raises InputError,
        also for a folder that holds another collection.
        """
        with open_journal(self.folder, self.fingerprint, fresh=fresh) as journal:
            if journal.torn:
                progress.note(TORN)
            folder = self.folder.resolve()
            files = ScenarioFiles(self.settings, self.run, self.entry_type, folder, self.name, journal, progress)
            try:
                make_folder(self.folder)
                remove_parts(self.folder)
                for path in (path for each in self.patterns for path in self.folder.glob(each)) if fresh else ():
                    path.unlink()
                files.find_kept(range(scenarios))
                progress.begin(scenarios, len(files.entries))
                missing = [index for index in range(scenarios) if index not in files.entries]
                try:
                    for _ in files.drive(missing, scenarios, workers):
                        pass
                finally:
                    found = [entry for _, entry in sorted(files.entries.items())]
                    self.write_index(found)
            except OSError as error:
                raise InputError(describe_write_error(error, error.filename or self.folder)) from None
        return found


@dataclass(frozen=True, slots=True)
class ShardPlan:
    """A shard of a data set, made or not."""

    name: str
    """Name of its file."""
    indices: tuple[int, ...]
    """Indices of its scenarios."""


def format_shard_name(number: int) -> str:
    """Return the file name of a shard."""
    return f"shard-{number:06d}.tar"


def collect_dataset(
    settings: CollectionSettings, folder: Path, scenarios: int, workers: int, progress: CollectionProgress, fresh: bool
) -> DatasetFile:
    """Make what is missing of a data set of so many scenarios and return its description.

    A shard that the journal does not know, or whose file is not the one that it knows, is made again. Raises
    InputError, also for a folder that holds another data set.
    """
    with open_journal(folder, settings.fingerprint, fresh=fresh) as journal:
        if journal.torn:
            progress.note(TORN)
        collection = _Collection(settings, folder.resolve(), scenarios, journal, progress)
        try:
            collection.prepare_folder(fresh)
            collection.find_kept()
            collection.drive_missing(workers)
            return collection.dataset
        except OSError as error:
            raise InputError(describe_write_error(error, error.filename or folder)) from None


@dataclass
class _Collection:
    """A data set in the making; nothing else works in its folder. Methods raise OSError for it."""

    settings: CollectionSettings
    folder: Path
    scenarios: int
    journal: Journal
    progress: CollectionProgress
    entries: dict[str, ShardEntry] = field(default_factory=dict[str, ShardEntry])
    """The shards that are there, by name."""
    waiting: ScenarioFiles[WaitingScenario] = field(init=False)
    """The finished scenarios of other shards."""

    def __post_init__(self) -> None:
        folder = self.folder / WAITING_FOLDER
        self.waiting = ScenarioFiles(
            self.settings, run_scenario_job, WaitingScenario, folder, "scenario-{:06d}.tar", self.journal, self.progress
        )

    @property
    def shards(self) -> list[ShardPlan]:
        """All shards, also those that are there."""
        firsts = range(0, self.scenarios, SHARD_SCENARIOS)
        return [
            ShardPlan(format_shard_name(number), tuple(range(first, min(first + SHARD_SCENARIOS, self.scenarios))))
            for number, first in enumerate(firsts)
        ]

    def prepare_folder(self, fresh: bool) -> None:
        """Remove what earlier starts left half written or, if `fresh`, finished."""
        make_folder(self.folder / WAITING_FOLDER)
        remove_parts(self.folder)
        remove_parts(self.folder / WAITING_FOLDER)
        if fresh:
            for path in (*self.folder.glob("shard-*.tar"), *(self.folder / WAITING_FOLDER).iterdir()):
                path.unlink()

    def find_kept(self) -> None:
        """Find what need not be made again, and remove the samples of all other scenarios."""
        noted = {entry.name: entry for entry in read_noted(self.journal, "shard", ShardEntry)}
        for shard in self.shards:
            entry = noted.get(shard.name)
            if entry is not None and self._is_kept(shard, entry):
                self.entries[shard.name] = entry
        self.waiting.find_kept(index for shard in self._missing for index in shard.indices)
        kept = {self.waiting.find_file(index) for index in self.waiting.entries}
        for path in self.waiting.folder.iterdir():
            if path not in kept:
                path.unlink()
        self.progress.begin(len(self.shards), len(self.entries), len(self.waiting.entries))

    @property
    def _missing(self) -> list[ShardPlan]:
        return [shard for shard in self.shards if shard.name not in self.entries]

    def _is_kept(self, shard: ShardPlan, entry: ShardEntry) -> bool:
        """Return whether a shard holds all its scenarios and is the file that was noted."""
        if not set(shard.indices) <= {one.index for one in entry.scenarios if one.status != "failed"}:
            return False
        path = self.folder / shard.name
        if is_as_noted(path, entry):
            return True
        self.progress.note(f"{path}: expected the shard that was written, found another file or none; it is made again")
        return False

    def drive_missing(self, workers: int) -> None:
        """Drive the scenarios that are missing and pack each shard when its last one is there. Raises InputError."""
        self._write_dataset()
        shard_by_index = {index: shard for shard in self._missing for index in shard.indices}
        missing = [index for index in shard_by_index if index not in self.waiting.entries]
        for shard in self._missing:  # a kill may come between the last scenario of a shard and the shard
            self._pack_if_complete(shard)
        for entry in self.waiting.drive(missing, self.scenarios, workers):
            self._pack_if_complete(shard_by_index[entry.scenario.index])
        with suppress(OSError):  # scenarios wait in it for one that has failed
            self.waiting.folder.rmdir()

    def _pack_if_complete(self, shard: ShardPlan) -> None:
        """Write a shard if all its scenarios wait; they are kept if one has failed, to be packed with it later."""
        if not all(index in self.waiting.entries for index in shard.indices):
            return
        scenarios = tuple(self.waiting.entries.pop(index).scenario for index in shard.indices)
        files = [self.waiting.find_file(one.index) for one in scenarios if one.samples]
        size, checksum = write_shard(self.folder / shard.name, read_members(files))
        samples = sum(one.samples for one in scenarios)
        entry = ShardEntry(name=shard.name, samples=samples, bytes=size, checksum=checksum, scenarios=scenarios)
        self.journal.add_result({"id": entry.name, "shard": entry.model_dump(mode="json")}, checksum)
        self.entries[entry.name] = entry
        self._write_dataset()
        if all(one.status != "failed" for one in scenarios):
            for one in scenarios:
                self.waiting.find_file(one.index).unlink(missing_ok=True)
        self.progress.finish_shard(entry)

    @property
    def dataset(self) -> DatasetFile:
        """What the data set holds now."""
        settings, shards = self.settings, tuple(entry for _, entry in sorted(self.entries.items()))
        return DatasetFile(
            program=__version__,
            split=settings.split,
            seed=settings.seed,
            expert=settings.expert,
            rigs=settings.rigs,
            perturbation=settings.perturbation,
            driver=settings.driver_checksum,
            mix=settings.mix,
            round=settings.round,
            share=settings.share,
            suite=settings.suite,
            requested=self.scenarios,
            samples=sum(shard.samples for shard in shards),
            shards=shards,
        )

    def _write_dataset(self) -> None:
        """Write `dataset.json`, whole or not at all."""
        write_text(self.folder / DATASET_FILE, self.dataset.model_dump_json(indent=1) + "\n")


def is_as_noted(path: Path, entry: ShardEntry | WaitingScenario) -> bool:
    """Return whether a file has the size and the checksum of its entry."""
    if not path.is_file() or path.stat().st_size != entry.bytes:
        return False
    return compute_file_checksum(path) == entry.checksum


Noted = TypeVar("Noted", bound=BaseModel)


def read_noted(journal: Journal, key: str, entry_type: type[Noted]) -> list[Noted]:
    """Return the entries of one kind, oldest first. Raises InputError."""
    entries: list[Noted] = []
    for line in journal.results:
        try:
            if key in line:
                entries.append(entry_type.model_validate(line[key]))
        except ValidationError as error:
            raise InputError(
                f"{journal.path}: {line['id']!r:.80}: {describe_first_error(error)}; --fresh starts anew"
            ) from None
    return entries


EXPERT_SHARE = 0.2
"""Share of the segments of a drive that the expert drives, as `learn data --mix`."""


@dataclass(frozen=True, slots=True)
class RoundPlan:
    """How much each round drives, and as what."""

    first: Path
    """Data set whose split, seed, expert, rigs, perturbation and share are used again."""
    places: Path
    """Folder of the places of its scenarios."""
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
        share=made.share,
        suite=made.suite,
        places=plan.places.resolve(),
    )
    collect_dataset(settings, folder, plan.scenarios, plan.workers, progress, fresh=False)
