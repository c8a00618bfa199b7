"""Record, convert and examine one synthetic recording; all recordings of a map share one network."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder, make_parents
from mdrive_sumo.generate.validation import ScenarioValidation, ValidationTask, validate_scenario
from mdrive_sumo.scenario.scenario import load_scenario, save_scenario
from mdrive_sumo.scenario.suite import SCENARIO_FILE, Suite, SuiteFile, save_suite
from real2sim.clean import clean_recording
from real2sim.network import NetworkReport, build_network
from real2sim.pipeline.conversion_options import NETWORKS, ConversionOptions
from real2sim.pipeline.quality_file import build_quality_file, save_quality
from real2sim.pipeline.scenario_builder import build_scenario
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.recording import vehicle_trajectories
from real2sim.source_scene import SourceScene
from real2sim.writers.episode_recording import build_hd_map
from real2sim.writers.v2xpnp_map import write_vector_map
from tools.synthetic_recordings.pose_thinning import thin_scenario
from tools.synthetic_recordings.record_drive import BUCKET, CATEGORY, find_window, record_drive, write_log

LOGS, MAPS, QUALITY = "logs", "maps", "quality"
ABOUT = SuiteFile(
    name="v2xpnp",
    title="Synthetic recordings in the V2XPnP format",
    description="Dense traffic at a crossing and in a corridor of our own, recorded in SUMO by CAVs and roadside units,"
    " written in the V2XPnP format with its noise, and converted back. Not the V2XPnP data set.",
)
VOTING_LOGS = 8
"""Number of logs whose vehicles determine lane directions and speeds."""


@dataclass(frozen=True)
class RecordingTask:
    """One recording: its parameters, folders and network."""

    place: str
    number: int
    cavs: int
    seed: int
    work: Path
    suite: Path
    network: NetworkReport | None = None

    @property
    def name(self) -> str:
        """Name of the log and of the scenario."""
        return f"{self.place}_{self.number:03d}"

    @property
    def group(self) -> str:
        """Map and number of CAVs."""
        return f"{self.place} {self.cavs}"

    @property
    def log(self) -> Path:
        """Folder of the log's agents."""
        return self.work / LOGS / self.name

    @property
    def map(self) -> Path:
        """Vector map of the log."""
        return self.work / MAPS / f"{self.place}.pkl"


@dataclass(frozen=True)
class RecordingOutcome:
    """Result of one recording."""

    task: RecordingTask
    misses: tuple[str, ...]
    """Missed targets of the conversion."""
    examined: ScenarioValidation
    """Result of `mdrive-sumo validate` for the scenario."""


def record_log(task: RecordingTask) -> Path | str:
    """Write the log and the map; return the log's folder, or why there is none."""
    _redirect_stdout()
    drive = record_drive(task.place, task.number, task.cavs, task.seed)
    if (part := find_window(drive)) is None:
        return f"{task.name}: no part of the drive in which all CAVs drive"
    write_log(drive, part, task.log, task.seed)
    make_parents(task.map)
    write_vector_map(build_hd_map(drive.roads), task.map.with_suffix(f".{task.number}"))
    task.map.with_suffix(f".{task.number}").replace(task.map)
    return task.log


def build_site_network(tasks: Sequence[RecordingTask]) -> NetworkReport:
    """Build SUITE/networks/<map> from the map and the motion in the first `VOTING_LOGS` logs."""
    first = tasks[0]
    name = f"v2xpnp_{first.place}"
    recordings = [read_v2xpnp(task.log, task.map) for task in tasks[:VOTING_LOGS]]
    seen = [
        motion
        for recording in recordings
        for motion in vehicle_trajectories(clean_recording(recording).tracks).values()
    ]
    return build_network(recordings[0].map, seen, first.suite / NETWORKS / name, name, recordings[0].dt_s)


def convert_recording(task: RecordingTask) -> RecordingOutcome | str:
    """Convert a log on its network and examine the scenario; return a sentence if that is impossible."""
    _redirect_stdout()
    recording = read_v2xpnp(task.log, task.map)
    scene = SourceScene(
        id=task.name,
        source=recording.source,
        bucket=BUCKET,
        category=CATEGORY,
        map=recording.map,
        recording=recording,
        description=f"synthetic recording in the V2XPnP format: {task.place} {task.number}, seed {task.seed}",
        notes=recording.notes,
    )
    try:
        built = build_scenario(scene, task.suite, ConversionOptions(), task.network)
    except InputError as error:
        return f"{task.name}: {error}"
    folder = task.suite / task.name
    save_scenario(thin_scenario(built.scenario), folder / SCENARIO_FILE)
    quality = task.work / QUALITY / task.name
    make_folder(quality)
    save_quality(build_quality_file(built.findings), quality)
    return RecordingOutcome(task, built.findings.misses, _examine(task))


def _examine(task: RecordingTask) -> ScenarioValidation:
    """Examine the written scenario in a suite of its own."""
    alone = task.work / "alone" / task.name
    save_suite(Suite(ABOUT, alone, (load_scenario(task.suite / task.name / SCENARIO_FILE),)))
    if not (alone / NETWORKS).exists():
        (alone / NETWORKS).symlink_to((task.suite / NETWORKS).resolve())
    return validate_scenario(ValidationTask(alone, task.name))


def _redirect_stdout() -> None:
    """Redirect standard output to standard error, because SUMO writes warnings there."""
    os.dup2(2, 1)
