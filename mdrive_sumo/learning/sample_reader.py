"""Read a data set of `learn data`: sample by sample, or all of it as arrays for training."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from mdrive_sumo.agents.learned.instructions import encode_instruction
from mdrive_sumo.agents.learned.navigation import take_limits
from mdrive_sumo.agents.learned.system_spec import PLAN_POINTS, SystemSpec
from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.learning.recorded_rigs import find_recorded_rig, list_stored_images
from mdrive_sumo.learning.sample_format import (
    BOX_COLUMNS,
    LANE_POINTS,
    MAX_BOXES,
    MAX_LANES,
    SampleAbout,
    ShardEntry,
    find_scenario_index,
    split_key,
)
from mdrive_sumo.learning.shard_reading import StoredSample, iterate_shard, load_dataset_file
from mdrive_sumo.learning.shared_arrays import ArrayPlace, Arrays, SharedArrays
from mdrive_sumo.runs.process_pool import ProcessPool
from mdrive_sumo.runs.worker_process import WorkerFailure

REMEMBERED_TICKS = 8
"""A sample's `previous` one is two decisions earlier: 0.4 s."""
SHARD_LIMIT_S = 3600.0
"""Wall clock for decoding one shard: it ends what hangs."""
KEPT = ("own", "navigation", "route", "expert_plan", "expert_control", "occupancy", "perturbed")
"""Labels of fixed shape that every system gets."""


@dataclass(frozen=True, slots=True)
class TrainingSample:
    """One decision of one CAV."""

    key: str
    images: Mapping[str, npt.NDArray[np.uint8]]
    """Pixels (cameras, H, W, 3) by `ImageInput.name`."""
    labels: Mapping[str, npt.NDArray[Any]]
    """Arrays by their name in `sample_format.LABELS`."""
    instruction: str
    about: SampleAbout


@dataclass(frozen=True, slots=True)
class DecodingJob:
    """One shard to decode in a worker process."""

    path: Path
    entry: ShardEntry
    spec: SystemSpec
    first_row: int
    places: Mapping[str, ArrayPlace]
    """The arrays of all samples."""


def read_samples(folder: Path, spec: SystemSpec | None = None) -> Iterator[TrainingSample]:
    """Yield the samples of a data set in order, with the images of a system; None: without images.

    Raises InputError for a data set that lacks the system's rig and for a broken shard, with shard and key.
    """
    for path, entry in _list_shards(folder, spec):
        for stored in iterate_shard(path, entry):
            yield decode_sample(stored, spec)


def decode_sample(stored: StoredSample, spec: SystemSpec | None) -> TrainingSample:
    """Return a sample with the images and the scan of a system. Raises InputError."""
    labels = stored.read_labels()
    if spec is not None and spec.uses_lidar and "lidar" not in labels:
        raise InputError(f"{stored.place}: expected an array lidar, which {spec.name} uses, found none")
    images = {} if spec is None else _read_images(stored, spec)
    return TrainingSample(stored.key, images, labels, stored.read_instruction(), stored.read_about())


def _read_images(stored: StoredSample, spec: SystemSpec) -> dict[str, npt.NDArray[np.uint8]]:
    return {
        image.name: np.stack(
            [stored.read_image(name, (image.height, image.width)) for name in list_stored_images(spec, image)]
        )
        for image in spec.images
    }


def load_arrays(folders: Path | Sequence[Path], spec: SystemSpec, workers: int = 1) -> Arrays:
    """Return all samples of data sets, M rows in order, as arrays for one system.

    Images by `ImageInput.name` (M, cameras, H, W, 3) uint8; `KEPT` as in `sample_format.LABELS`, occupancy packed;
    `limits` of the route; `lidar` and `instruction` (M, INSTRUCTION_WORDS) int64 if the system uses them; `boxes`
    (M, MAX_BOXES, 9), `futures` (M, MAX_BOXES, PLAN_POINTS, 3) and `lane_graph` (M, MAX_LANES, LANE_POINTS, 2), NaN
    where there is nothing; `scenario` (M,) int32, its index; `episode` (M,) int32, the number of the CAV's drive;
    `previous` (M,) int32, the row of the same CAV's sample 0.4 s earlier or -1. workers: processes that decode shards,
    into memory that this process shares. Raises InputError as `read_samples`, also without samples.
    """
    listed = [folders] if isinstance(folders, Path) else list(folders)
    shards = [shard for folder in listed for shard in _list_shards(folder, spec) if shard[1].samples]
    if not shards:
        raise InputError(f"{', '.join(map(str, listed))}: expected a data set with samples, found none")
    first_rows = np.cumsum([0, *(entry.samples for _, entry in shards)])
    row = _build_row(decode_sample(next(iterate_shard(*shards[0])), spec), spec)
    with SharedArrays(row, int(first_rows[-1])) as shared:
        jobs = [
            DecodingJob(path, entry, spec, first, shared.places)
            for (path, entry), first in zip(shards, first_rows.tolist(), strict=False)
        ]
        keys = dict(_decode_shards(jobs, workers))
    ordered = [key for job in jobs for key in keys[job.first_row]]
    shard_of_row = np.repeat(np.arange(len(jobs)), np.diff(first_rows)).tolist()
    return shared.arrays | link_samples(ordered, shard_of_row)


def _decode_shards(jobs: Sequence[DecodingJob], workers: int) -> Iterator[tuple[int, list[str]]]:
    """Fill the rows of each shard and yield its first row with its keys, in the order in which they finish."""
    if workers == 1 or len(jobs) == 1:
        yield from ((job.first_row, decode_shard(job)) for job in jobs)
        return
    with ProcessPool(decode_shard, workers, SHARD_LIMIT_S) as pool:
        for job, outcome in pool.run(jobs):
            if isinstance(outcome, WorkerFailure):
                raise (
                    InputError(outcome.reason)
                    if outcome.kind == "input"
                    else WorldError(f"{job.path}: {outcome.reason}")
                )
            yield job.first_row, outcome


def decode_shard(job: DecodingJob) -> list[str]:
    """Write the samples of one shard into their rows, see `load_arrays`, and return their keys. Raises InputError."""
    keys: list[str] = []
    arrays = {name: place.open() for name, place in job.places.items()}
    for row, stored in enumerate(iterate_shard(job.path, job.entry), start=job.first_row):
        keys.append(stored.key)
        for name, value in _build_row(decode_sample(stored, job.spec), job.spec).items():
            arrays[name][row] = value
    return keys


def _build_row(sample: TrainingSample, spec: SystemSpec) -> Arrays:
    row: Arrays = {**sample.images, **{name: sample.labels[name] for name in KEPT}}
    row["limits"] = take_limits(sample.labels["route"])
    if spec.uses_lidar:
        row["lidar"] = sample.labels["lidar"]
    if spec.uses_instruction:
        row["instruction"] = encode_instruction(sample.instruction)
    row["boxes"] = _pad(sample.labels["boxes"], (MAX_BOXES, len(BOX_COLUMNS)))
    row["futures"] = _pad(sample.labels["futures"], (MAX_BOXES, PLAN_POINTS, 3))
    row["lane_graph"] = _pad(sample.labels["lane_graph"], (MAX_LANES, LANE_POINTS, 2))
    return row


def _pad(values: npt.NDArray[Any], shape: tuple[int, ...]) -> npt.NDArray[Any]:
    padded = np.full(shape, np.nan, values.dtype)
    count = min(len(values), shape[0])
    padded[:count] = values[:count]
    return padded


def link_samples(keys: Sequence[str], shards: Sequence[int]) -> Arrays:
    """Return `scenario`, `episode` and `previous` of `load_arrays`.

    shards: (M,) keys of different data sets may be equal, those of one shard are not. Raises InputError.
    """
    rows: dict[tuple[int, str, int], int] = {}
    drives: dict[tuple[int, str], int] = {}
    scenario, episode, previous = (np.empty(len(keys), np.int32) for _ in range(3))
    for row, (key, shard) in enumerate(zip(keys, shards, strict=True)):
        try:
            drive, tick = split_key(key)
            scenario[row] = find_scenario_index(drive)
        except ValueError:
            raise InputError(f"sample {key!r:.80}: expected a key EPISODE_CAV_TICK, found another") from None
        rows[shard, drive, tick] = row
        episode[row] = drives.setdefault((shard, drive), len(drives))
        previous[row] = rows.get((shard, drive, tick - REMEMBERED_TICKS), -1)
    return {"scenario": scenario, "episode": episode, "previous": previous}


def _list_shards(folder: Path, spec: SystemSpec | None) -> list[tuple[Path, ShardEntry]]:
    dataset = load_dataset_file(folder)
    rig = "" if spec is None else find_recorded_rig(spec.rig)
    if spec is not None and rig not in dataset.rigs:
        raise InputError(
            f"{folder}: expected images of the rig {rig}, which {spec.name} uses, found"
            f" {', '.join(dataset.rigs) or 'no images'}; `learn data --rig {rig}` records them"
        )
    return [(folder / shard.name, shard) for shard in dataset.shards]
