"""Record, convert and examine one synthetic recording; all recordings of a map share one network."""

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder, make_parents
from mdrive_sumo.generate.selection import SelectionItem, build_item
from mdrive_sumo.generate.validation import ScenarioValidation, ValidationTask, validate_scenario
from mdrive_sumo.roads import load_road_map
from mdrive_sumo.scenario.scenario import Scenario, load_scenario, save_scenario
from mdrive_sumo.scenario.suite import SCENARIO_FILE, Suite, SuiteFile, save_suite
from real2sim.clean import clean_recording
from real2sim.conversion_findings import ConversionFindings
from real2sim.network import NetworkReport, build_network
from real2sim.pipeline.conversion_options import NETWORKS, ConversionOptions
from real2sim.pipeline.quality_file import build_quality_file, save_quality
from real2sim.pipeline.scenario_builder import build_scenario, make_reactive
from real2sim.readers.v2xpnp import read_v2xpnp
from real2sim.recorded_drives.pose_thinning import thin_scenario
from real2sim.recorded_drives.probe_scenario import probe_scenario
from real2sim.recorded_drives.record_drive import BUCKET, CATEGORY, find_window, record_drive, write_log
from real2sim.recorded_drives.recording_site import RecordingSite
from real2sim.recording import vehicle_trajectories
from real2sim.source_scene import SourceScene
from real2sim.tracks.track_contacts import find_contacts
from real2sim.traffic_fidelity.log_simulation import simulate_log
from real2sim.traffic_fidelity.traffic_fidelity import SLACK_M, replace_poses
from real2sim.writers.episode_recording import build_hd_map
from real2sim.writers.v2xpnp_map import write_vector_map

LOGS, MAPS, QUALITY, SUITE = "logs", "maps", "quality", "suite"
ABOUT = SuiteFile(name="examined", title="One converted recording")
VOTING_LOGS = 4
"""Number of logs whose vehicles determine lane directions and speeds."""


@dataclass(frozen=True)
class RecordingTask:
    """One recording: its parameters, folders and network."""

    site: RecordingSite
    number: int
    cavs: int
    seed: int
    work: Path
    network: NetworkReport | None = None

    @property
    def name(self) -> str:
        """Name of the log and of the scenario."""
        return f"{self.site.network.name}_{self.number:03d}"

    @property
    def log(self) -> Path:
        """Folder of the log's agents."""
        return self.work / LOGS / self.name

    @property
    def map(self) -> Path:
        """Vector map of the log."""
        return self.work / MAPS / f"{self.site.network.name}.pkl"

    @property
    def network_folder(self) -> Path:
        """Folder of the converted network, which all recordings of the place share."""
        return self.work / SUITE / NETWORKS / f"v2xpnp_{self.site.network.name}"

    @property
    def scenario_file(self) -> Path:
        """File of the converted scenario."""
        return self.work / SUITE / self.name / SCENARIO_FILE


@dataclass(frozen=True)
class RecordingOutcome:
    """Result of one recording."""

    name: str
    misses: tuple[str, ...]
    """Missed targets of the conversion."""
    problems: tuple[str, ...]
    """Why the scenario is not used: `mdrive-sumo validate` does not accept it, the CAVs of the log have infractions, or
    an agent's score is out of bounds."""
    scores: Mapping[str, float]
    """Mean driving score of each agent of `probe_scenario`; none of a scenario with problems."""
    item: SelectionItem
    """Figures for the selection."""


def record_log(task: RecordingTask) -> str:
    """Write the log and the map; return why there is none, or ""."""
    _redirect_stdout()
    try:
        drive = record_drive(task.site, task.name, task.cavs, task.seed)
    except InputError as error:
        return str(error)
    if (part := find_window(drive)) is None:
        return "no part of the drive in which all CAVs drive"
    write_log(drive, part, task.log, task.seed)
    make_parents(task.map)
    write_vector_map(build_hd_map(drive.roads), task.map.with_suffix(f".{task.number}"))
    task.map.with_suffix(f".{task.number}").replace(task.map)
    return ""


def build_site_network(tasks: Sequence[RecordingTask]) -> NetworkReport | str:
    """Build WORK/suite/networks/<name> from the map and the motion in the first `VOTING_LOGS` logs.

    Return a sentence if that is impossible.
    """
    first = tasks[0]
    recordings = [read_v2xpnp(task.log, task.map) for task in tasks[:VOTING_LOGS]]
    seen = [
        motion
        for recording in recordings
        for motion in vehicle_trajectories(clean_recording(recording).tracks).values()
    ]
    # The format has no buildings, which hide road users: they come from the place.
    map_ = replace(recordings[0].map, buildings=build_hd_map(load_road_map(first.site.network)).buildings)
    try:
        return build_network(map_, seen, first.network_folder, first.network_folder.name, recordings[0].dt_s)
    except InputError as error:
        return str(error)


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
        description=f"synthetic recording in the V2XPnP format: {task.site.network.name} {task.number}",
        notes=recording.notes,
    )
    try:
        built = build_scenario(scene, task.work / SUITE, ConversionOptions(), task.network)
    except InputError as error:
        return str(error)
    scenario = thin_scenario(built.scenario)
    save_scenario(scenario, task.scenario_file)
    quality = task.work / QUALITY / task.name
    make_folder(quality)
    save_quality(build_quality_file(built.findings), quality)
    problems, scores = _find_problems(task, scenario, built.findings), {}
    if not problems:
        probed = probe_scenario(scenario, load_road_map(task.network_folder))
        problems, scores = ((probed,), {}) if isinstance(probed, str) else ((), probed)
    return RecordingOutcome(task.name, built.findings.misses, problems, scores, build_item(scenario, task.site.setting))


def _find_problems(task: RecordingTask, scenario: Scenario, findings: ConversionFindings) -> tuple[str, ...]:
    drive = findings.logged_drive
    infractions = () if drive is None else drive.unconfirmed
    logged = tuple(f"the log has {infraction.kind} of CAV {cav}" for cav, infraction in infractions)
    if logged or (logged := tuple(_find_hits(scenario, findings))):
        return logged
    found = _examine(task)
    return found.problems or (() if found.blind_ttc_s is not None else ("blind driving has no conflict",))


def _find_hits(scenario: Scenario, findings: ConversionFindings) -> Iterator[str]:
    """Yield the background vehicles that touch a CAV which drives as in the log,."""
    recording, names = findings.recording, findings.names
    by_name = {names[track.id]: track for track in findings.tracks if track.id in names}
    run = simulate_log(make_reactive(scenario), findings.roads, by_name, recording.dt_s)
    cavs = [by_name[ego.id] for ego in scenario.egos]
    others = [one.id for one in scenario.background.vehicles if one.id in run.poses]
    placed = [replace_poses(by_name[name], run.poses[name]) for name in others]
    for i, j, _ in find_contacts([*cavs, *placed], SLACK_M).collisions:
        if i < len(cavs) <= j:
            yield f"background vehicle {others[j - len(cavs)]} hits CAV {scenario.egos[i].id} that drives as logged"


def _examine(task: RecordingTask) -> ScenarioValidation:
    """Examine the written scenario in a suite of its own."""
    alone = task.work / "alone" / task.name
    save_suite(Suite(ABOUT, alone, (load_scenario(task.scenario_file),)))
    if not (alone / NETWORKS).exists():
        (alone / NETWORKS).symlink_to((task.work / SUITE / NETWORKS).resolve())
    return validate_scenario(ValidationTask(alone, task.name))


def _redirect_stdout() -> None:
    """Redirect standard output to standard error, because SUMO writes warnings there."""
    os.dup2(2, 1)
