"""Make a data set of fusion frames: scenarios are driven in worker processes; an interrupted collection goes on.

What is in an archive depends on the settings and the index of its scenario only. A scenario has an archive of its own:
one process that packed those of many workers would compress longer than they drive.
"""

from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.agents.learned.fusion_spec import GRID_VERSION, MAX_CAVS
from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.core.version import __version__
from mdrive_sumo.learning.array_files import write_arrays
from mdrive_sumo.learning.collection import CollectionProgress, FileCollection
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.drive_episode import drive_scenario
from mdrive_sumo.learning.fusion.drive_frames import DriveFrames, FrameSampling, build_drive_frames
from mdrive_sumo.learning.fusion.frame_files import ARCHIVE_NAME, FORMAT, write_archive, write_index
from mdrive_sumo.learning.fusion.frames import FusionFrames
from mdrive_sumo.learning.sample_format import CollectedScenario
from mdrive_sumo.learning.scenario_jobs import ScenarioJob, WaitingScenario
from mdrive_sumo.runs.journal import Fingerprint

POINTS_PREFIX, FRAMES_PREFIX = "points-", "frames-"
"""Beginnings of the names of archives with the points of scans, and of those with frames."""


class FrameArchive(WaitingScenario):
    """A finished scenario and its archive, if it has frames; `samples` are frames."""

    cavs: int = 0
    """Of the scenario."""
    senders: tuple[int, ...] = (0,) * (MAX_CAVS - 1)
    """Frames with one sender, with two, ..."""


@dataclass(frozen=True, slots=True)
class FrameSet:
    """What a folder of frames holds."""

    archives: tuple[FrameArchive, ...]
    """One for each scenario, in the order of their indices."""

    @property
    def scenarios(self) -> list[CollectedScenario]:
        """What became of the scenarios."""
        return [archive.scenario for archive in self.archives]


def collect_frames(
    settings: CollectionSettings,
    sampling: FrameSampling,
    folder: Path,
    scenarios: int,
    workers: int,
    progress: CollectionProgress,
    fresh: bool,
) -> FrameSet:
    """Make what is missing of the frames of so many scenarios and return what there is, see `FileCollection.collect`.

    Raises InputError.
    """
    collection = FileCollection(
        settings,
        build_fingerprint(settings, sampling),
        partial(run_frame_job, sampling),
        FrameArchive,
        folder,
        ARCHIVE_NAME,
        (f"{FRAMES_PREFIX}*.npz", f"{POINTS_PREFIX}*.npz"),
        lambda found: _write_index(settings, sampling, folder, scenarios, FrameSet(tuple(found))),
    )
    return FrameSet(tuple(collection.collect(scenarios, workers, progress, fresh)))


def build_fingerprint(settings: CollectionSettings, sampling: FrameSampling) -> Fingerprint:
    """Return what makes two collections the same."""
    return {
        **settings.fingerprint,
        "collection": FORMAT,
        "grid_version": GRID_VERSION,
        "interval_ticks": sampling.interval_ticks,
        "least_cavs": sampling.least_cavs,
        "least_others": sampling.least_others,
    }


def run_frame_job(sampling: FrameSampling, job: ScenarioJob) -> FrameArchive:
    """Drive a scenario and write its frames. Raises InputError and OSError."""
    chosen = job.settings.load_scenario(job.index)
    if chosen is None or not sampling.fits(chosen[0]):
        about = CollectedScenario(index=job.index, status="none", scenario=chosen[0].id if chosen else "")
        return FrameArchive(scenario=about, bytes=0, checksum="", cavs=len(chosen[0].egos) if chosen else 0)
    scenario, cavs = chosen[0].id, len(chosen[0].egos)
    try:
        drive = drive_scenario(job.settings, *chosen, job.settings.derive_episode_seed(job.index))
    except WorldError as error:
        failed = CollectedScenario(index=job.index, status="failed", scenario=scenario, reason=str(error))
        return FrameArchive(scenario=failed, bytes=0, checksum="", cavs=cavs)
    made = build_drive_frames(drive, sampling)
    done = CollectedScenario(
        index=job.index,
        status="done",
        scenario=scenario,
        ticks=int(drive.episode.valid[:, : drive.episode.egos].sum()),
        samples=len(made.frames),
        dropped=made.left_out,
    )
    if not len(made.frames):
        return FrameArchive(scenario=done, bytes=0, checksum="", cavs=cavs)
    size, checksum = _write_archives(job.path, made)
    return FrameArchive(scenario=done, bytes=size, checksum=checksum, cavs=cavs, senders=count_senders(made.frames))


def _write_archives(path: Path, made: DriveFrames) -> tuple[int, str]:
    """Write the archives of a drive; return size [bytes] and checksum of the one with the frames."""
    if len(made.points.scan):
        names = "scan", "starts", "points", "intensity"
        beside = path.with_name(path.name.replace(FRAMES_PREFIX, POINTS_PREFIX))
        write_arrays(beside, {name: getattr(made.points, name) for name in names})
    write_archive(path, made.frames)
    return path.stat().st_size, compute_file_checksum(path)


def count_senders(frames: FusionFrames) -> tuple[int, ...]:
    """Return how many frames have one sender, how many two, and so on."""
    senders = (frames.scan[:, 1:, 0] >= 0).sum(axis=1)
    return tuple(np.bincount(senders, minlength=MAX_CAVS)[1:].tolist())


def _write_index(
    settings: CollectionSettings, sampling: FrameSampling, folder: Path, scenarios: int, found: FrameSet
) -> None:
    about: dict[str, Any] = {
        "program": __version__,
        "seed": settings.seed,
        "expert": settings.expert,
        "suite": settings.suite,
        "interval_ticks": sampling.interval_ticks,
        "least_cavs": sampling.least_cavs,
        "least_others": sampling.least_others,
        "requested": scenarios,
        "frames": sum(one.samples for one in found.scenarios),
        "scenarios": [archive.model_dump(mode="json") for archive in found.archives],
    }
    names = [ARCHIVE_NAME.format(one.index) for one in found.scenarios if one.samples]
    write_index(folder, settings.split, names, about)
