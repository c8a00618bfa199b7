"""Training data from takes: people in place of an expert. A sample for every decision in which a person drives on.

The plan of a sample is the way that the person took in the next 3 s, its control that of the tick.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

import numpy as np

from mdrive_sumo.agents.learned.ego_frame import convert_to_frame
from mdrive_sumo.agents.learned.navigation import RouteNavigator
from mdrive_sumo.agents.learned.system_spec import DECISION_TICKS
from mdrive_sumo.contract import Control, Observation, OwnState
from mdrive_sumo.contract.human_options import HUMAN
from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.version import __version__
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.export.demonstrations import Known, select_new_ticks
from mdrive_sumo.export.export_run import select_recorded
from mdrive_sumo.learning.collection import CollectionProgress, format_shard_name
from mdrive_sumo.learning.drive_episode import find_usable_end
from mdrive_sumo.learning.recorded_rigs import build_rig_sensors
from mdrive_sumo.learning.recording_agent import (
    EncodedSight,
    ExpertAnswer,
    RecordedDecision,
    build_decision,
    encode_sight,
)
from mdrive_sumo.learning.sample_files import SampleFiles, encode_sample, pack_samples, write_shard
from mdrive_sumo.learning.sample_format import (
    DATASET_FILE,
    CollectedScenario,
    DatasetFile,
    SampleAbout,
    ShardEntry,
    format_key,
)
from mdrive_sumo.learning.scene_labels import LATER_TICKS, Labels, SceneLabels
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.runs.episode_job import load_job_scenario
from mdrive_sumo.runs.recording_check import load_recording
from mdrive_sumo.runs.stored_run import StoredRun
from mdrive_sumo.runs.takes import ObservedTake, RecordedActions, observe_take
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.scoring.metrics import ScoredEpisode, build_ego_records

SPLIT = "takes"
"""In place of a split of training scenarios: people drive scenarios of suites."""


@dataclass
class _Decisions:
    """What a CAV is shown at its decisions, also at those that are no samples: place and memory go on."""

    ticks: frozenset[int]
    """Of the samples."""
    sensors: frozenset[str]
    """Ids of the recorded cameras and LiDARs: agents that may drive can have some of their own."""
    seen: dict[int, tuple[OwnState, EncodedSight | None]] = field(
        default_factory=dict[int, tuple[OwnState, EncodedSight | None]]
    )
    """Own state by tick, and what rigs show in the ticks of samples."""

    def add(self, seen: Observation) -> None:
        """Keep what is shown at a decision."""
        sight = None
        if seen.tick in self.ticks:
            cameras = {name: image for name, image in seen.cameras.items() if name in self.sensors}
            lidar = {name: scan for name, scan in seen.lidar.items() if name in self.sensors}
            sight = encode_sight(Observation(seen.tick, seen.own, cameras=cameras, lidar=lidar))
        self.seen[seen.tick] = seen.own, sight


@dataclass(frozen=True, slots=True)
class _Drive:
    """A take that has been driven again, with the scenario as its seed draws it."""

    take: ObservedTake
    scenario: Scenario
    roads: RoadMap
    seed: int


def collect_demonstrations(
    takes: Sequence[StoredRun], rigs: tuple[str, ...], out: Path, progress: CollectionProgress
) -> DatasetFile:
    """Write a data set into `out`, a new or empty folder: a shard for each take that has samples.

    rigs: names as `find_recorded_rig` returns them. Raises InputError, also without any sample.
    """
    known: Known = set()
    entries: list[ShardEntry] = []
    with atomic_folder(out) as draft:
        for stored in takes:
            for result in select_recorded(stored):
                entry = _collect_take(stored, result, rigs, known, (draft, len(entries)))
                if entry.samples:
                    entries.append(entry)
                    progress.finish_scenario(entry.scenarios[0])
                    progress.finish_shard(entry)
        if not entries:
            raise InputError(f"{takes[0].run.folder}: expected a person who drives for 3 s or more, found none")
        dataset = _describe(takes, rigs, entries)
        write_text(draft / DATASET_FILE, dataset.model_dump_json(indent=1) + "\n")
    return dataset


def _describe(takes: Sequence[StoredRun], rigs: tuple[str, ...], entries: Sequence[ShardEntry]) -> DatasetFile:
    return DatasetFile(
        program=__version__,
        split=SPLIT,
        seed=0,
        expert=HUMAN,
        rigs=rigs,
        perturbation=0.0,
        driver="",
        mix=0.0,
        round=0,
        suite=", ".join(sorted({one.run.suite.name for one in takes})),
        requested=len(takes),
        samples=sum(entry.samples for entry in entries),
        shards=tuple(entries),
    )


def _collect_take(
    stored: StoredRun, result: ScenarioResult, rigs: tuple[str, ...], known: Known, place: tuple[Path, int]
) -> ShardEntry:
    """Write the shard of a take, if it has samples. place: folder and number of the shard."""
    folder, number = place
    record = load_recording(stored.run, result)
    job = stored.run.make_job(next(one for one in stored.run.scenarios if one.id == result.id), result.seed)
    scenario, roads = load_job_scenario(job)
    due = {ego: _select_decisions(record, result, ego, known) for ego in record.ego_ids}
    usable = {
        one.id: find_usable_end(one, record, True) for one in build_ego_records(ScoredEpisode(record, scenario, roads))
    }
    kept = {ego: frozenset(tick for tick in ticks if tick < usable[ego]) for ego, ticks in due.items()}
    samples: list[SampleFiles] = []
    if any(kept.values()):
        sensors = build_rig_sensors(rigs)
        shown = {ego: _Decisions(ticks, frozenset(spec.id for spec in sensors)) for ego, ticks in kept.items()}
        take = observe_take(job, record, partial(_show, shown), sensors)
        samples = _build_samples(_Drive(take, scenario, roads, result.seed), shown, number)
    name = format_shard_name(number)
    size, checksum = write_shard(folder / name, pack_samples(samples)) if samples else (0, "")
    about = CollectedScenario(
        index=number,
        status="done",
        scenario=result.id,
        ticks=sum(len(RecordedActions(record, ego).list_person_ticks()) for ego in record.ego_ids),
        samples=len(samples),
        dropped=sum(map(len, due.values())) - len(samples),
    )
    return ShardEntry(name=name, samples=len(samples), bytes=size, checksum=checksum, scenarios=(about,))


def _select_decisions(record: EpisodeRecord, result: ScenarioResult, ego: str, known: Known) -> frozenset[int]:
    """Return the ticks of decisions from which on a person drives as long as a plan lasts, and that are new."""
    driven = set(RecordedActions(record, ego).list_person_ticks())
    new, _ = select_new_ticks(record, result, ego, known)
    horizon = int(LATER_TICKS[-1])
    return frozenset(
        tick for tick in new if tick % DECISION_TICKS == 0 and driven.issuperset(range(tick, tick + horizon + 1))
    )


def _show(shown: Mapping[str, _Decisions], tick: int, observations: Mapping[str, Observation]) -> None:
    if tick % DECISION_TICKS == 0:
        for ego, one in shown.items():
            if one.ticks and ego in observations:
                one.add(observations[ego])


def _build_samples(drive: _Drive, shown: Mapping[str, _Decisions], number: int) -> list[SampleFiles]:
    """Return the samples of a take, CAV by CAV in the order of time."""
    scenes = _build_scenes(drive, shown)
    samples: list[SampleFiles] = []
    for cav, ego in enumerate(drive.take.record.ego_ids):
        for one in _build_decisions(drive, ego, shown[ego]):
            key = format_key(f"{SPLIT}-{number:06d}", cav, one.tick)
            samples.append(encode_sample(key, one, scenes[one.tick][cav], _describe_sample(drive, ego, one.tick)))
    return samples


def _build_scenes(drive: _Drive, shown: Mapping[str, _Decisions]) -> dict[int, Mapping[int, Labels]]:
    """Return the true labels by tick and CAV, in the order of ticks: they tell what has been seen before."""
    cavs_by_tick: dict[int, list[int]] = {}
    for cav, ego in enumerate(drive.take.record.ego_ids):
        for tick in shown[ego].seen:
            cavs_by_tick.setdefault(tick, []).append(cav)
    labels = SceneLabels(drive.take.record, drive.roads)
    return {tick: labels.build(tick, cavs_by_tick[tick]) for tick in sorted(cavs_by_tick)}


def _describe_sample(drive: _Drive, ego: str, tick: int) -> SampleAbout:
    scenario = drive.scenario
    return SampleAbout(
        scenario=scenario.id, network=scenario.network, seed=drive.seed, cav=ego, tick=tick, expert=HUMAN, round=0
    )


def _build_decisions(drive: _Drive, ego: str, shown: _Decisions) -> list[RecordedDecision]:
    record = drive.take.record
    navigator, column = RouteNavigator(drive.take.briefings[ego]), record.ego_ids.index(ego)
    found: list[RecordedDecision] = []
    for tick, (own, sight) in shown.seen.items():
        navigation = navigator.locate(own)
        if sight is None:
            continue
        control = Control(*record.control_values[tick, column].tolist())
        answer = ExpertAnswer(read_way(record, column, tick), control, True)
        found.append(build_decision(sight, own, navigation, answer, drive.seed))
    return found


def read_way(record: EpisodeRecord, column: int, tick: int) -> Float:
    """Return where a CAV is at the times of a plan (PLAN_POINTS, 2) [m], in its true ego frame of a tick."""
    later = tick + LATER_TICKS
    points = np.stack((record.x[later, column], record.y[later, column]), axis=-1)
    pose = np.array((record.x[tick, column], record.y[tick, column], record.yaw[tick, column]))
    return convert_to_frame(points, pose)
