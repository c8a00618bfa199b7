"""Drive one training scenario and build its samples, those before a CAV failed: they teach something."""

from collections.abc import Generator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mdrive_sumo.contract import Agent, Briefing
from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.core.state import TICKS_PER_SECOND, End
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.learner_driver import build_learner
from mdrive_sumo.learning.recording_agent import RecordedDecision, RecordingAgent, RecordingSetup
from mdrive_sumo.learning.sample_files import SampleFiles, encode_sample
from mdrive_sumo.learning.sample_format import CollectedScenario, SampleAbout, format_key
from mdrive_sumo.learning.scene_labels import Labels, SceneLabels
from mdrive_sumo.loop import EpisodeConfig, EpisodeSimulation, SimulatedFrames, start_agents
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.loop.agent_scheduler import AgentScheduler
from mdrive_sumo.loop.open_world import open_world
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring.metrics import EgoRecord, ScoredEpisode, build_ego_records

if TYPE_CHECKING:
    from mdrive_sumo.sumo import SumoWorld


@dataclass(frozen=True)
class CollectedDrive:
    """A finished episode with the decisions of its CAVs, in the order of the scenario file."""

    config: EpisodeConfig
    episode: EpisodeRecord
    briefings: Mapping[str, Briefing]
    """By CAV."""
    decisions: Sequence[Sequence[RecordedDecision]]
    """Of each CAV those that are kept."""
    decided_ticks: Sequence[Sequence[int]]
    """Of each CAV the ticks of all: what was seen at them is remembered."""


def collect_scenario(settings: CollectionSettings, index: int) -> tuple[CollectedScenario, list[SampleFiles]]:
    """Drive the scenario of an index; return what became of it and its samples, CAV by CAV in the order of time.

    A failure of the simulator or of an agent is a status. Raises InputError.
    """
    chosen = settings.load_scenario(index)
    if chosen is None:
        return CollectedScenario(index=index, status="none"), []
    scenario, roads = chosen
    try:
        drive = drive_scenario(settings, scenario, roads, settings.derive_episode_seed(index))
    except WorldError as error:
        return CollectedScenario(index=index, status="failed", scenario=scenario.id, reason=str(error)), []
    samples, dropped = build_samples(settings, drive, settings.format_episode(index))
    ticks = int(drive.episode.valid[:, : drive.episode.egos].sum())
    done = CollectedScenario(
        index=index, status="done", scenario=scenario.id, ticks=ticks, samples=len(samples), dropped=dropped
    )
    return done, samples


def drive_scenario(settings: CollectionSettings, scenario: Scenario, roads: RoadMap, seed: int) -> CollectedDrive:
    """Return the recording of one episode. Raises WorldError, also if an expert or a learner fails."""
    config = EpisodeConfig(scenario, roads, seed)
    sensing_seed = config.sensor_context.seed
    agents = {ego.id: RecordingAgent(_build_setup(settings, seed, sensing_seed, ego.id)) for ego in scenario.egos}
    with open_drive(config, agents) as drive:
        while not drive.simulation.is_done:
            drive.step()
    episode, simulation = drive.simulation.finish(), drive.simulation
    decisions, ticks = zip(*((agent.decisions, agent.decided_ticks) for agent in agents.values()), strict=True)
    return CollectedDrive(config, episode, simulation.briefings, decisions, ticks)


class LiveDrive:
    """An episode in progress, tick by tick."""

    def __init__(self, config: EpisodeConfig, world: "SumoWorld", agents: Mapping[str, Agent]) -> None:
        self._drivers = {ego: LocalDriver(agent) for ego, agent in agents.items()}
        self.simulation: EpisodeSimulation = start_agents(config, SimulatedFrames(config, world), self._drivers)
        self._scheduler = AgentScheduler(self._drivers, config.options.clock, (), self.simulation.fail_agent)
        self._observations = self.simulation.reset()
        self._scenario = config.scenario.id

    def step(self) -> None:
        """Advance by one tick. Raises WorldError, also if an agent fails."""
        simulation = self.simulation
        self._observations = simulation.step(self._scheduler.collect_replies(simulation.tick, self._observations))
        for ego, reason in simulation.failed_agents.items():
            raise WorldError(f"scenario {self._scenario}: the agent of {ego} failed: {reason}")


@contextmanager
def open_drive(config: EpisodeConfig, agents: Mapping[str, Agent]) -> Generator[LiveDrive]:
    """Start an episode with an agent for each CAV; close its world afterwards. Raises WorldError."""
    with open_world(config) as world:
        yield LiveDrive(config, world, agents)


def _build_setup(settings: CollectionSettings, seed: int, sensing_seed: int, ego: str) -> RecordingSetup:
    learner, system = build_learner(settings.driver) if settings.driver is not None else (None, None)
    return RecordingSetup(
        expert=settings.build_expert(),
        rigs=settings.rigs,
        seed=derive_seed(seed, "learning", ego),
        estimator_seed=derive_seed(sensing_seed, "own-state", ego),
        perturbation=settings.perturbation,
        learner=learner,
        system=system,
        mix=settings.mix,
        share=settings.share,
    )


def build_samples(
    settings: CollectionSettings, drive: CollectedDrive, episode_name: str
) -> tuple[list[SampleFiles], int]:
    """Return the samples of a drive, and the number of decisions that are left out, see `find_usable_end`."""
    scenario, episode = drive.config.scenario, drive.episode
    records = build_ego_records(ScoredEpisode(episode, scenario, drive.config.roads))
    ends = [find_usable_end(record, episode, settings.driver is None) for record in records]
    kept = [[one for one in decisions if one.tick < end] for decisions, end in zip(drive.decisions, ends, strict=True)]
    scenes = _build_scenes(drive, ends)
    samples: list[SampleFiles] = []
    for cav, ego in enumerate(scenario.egos):
        about = SampleAbout(
            scenario=scenario.id,
            network=scenario.network,
            seed=drive.config.seed,
            cav=ego.id,
            tick=0,
            expert=settings.expert,
            round=settings.round,
        )
        for one in kept[cav]:
            key = format_key(episode_name, cav, one.tick)
            samples.append(encode_sample(key, one, scenes[cav, one.tick], about.model_copy(update={"tick": one.tick})))
    return samples, sum(map(len, drive.decisions)) - len(samples)


def _build_scenes(drive: CollectedDrive, ends: Sequence[int]) -> Mapping[tuple[int, int], Labels]:
    """Return the true labels by CAV and tick of all decisions before the `ends` of the CAVs."""
    labels = SceneLabels(drive.episode, drive.config.roads)
    cavs_by_tick: dict[int, list[int]] = {}
    for cav, (ticks, end) in enumerate(zip(drive.decided_ticks, ends, strict=True)):
        for tick in ticks:
            if tick < end:
                cavs_by_tick.setdefault(tick, []).append(cav)
    return {
        (cav, tick): label
        for tick in sorted(cavs_by_tick)
        for cav, label in labels.build(tick, cavs_by_tick[tick]).items()
    }


BEFORE_FAILURE_TICKS = 4 * TICKS_PER_SECOND
"""An expert that drives does wrong from so long before an infraction on: planners look 3 to 8 s ahead."""
MOVING_SPEED = 0.1
"""[m/s]"""
SHARE_OF_WAY = "outside-lanes"
"""An infraction without a time: it is noted at the end of the drive."""


def find_usable_end(record: EgoRecord, episode: EpisodeRecord, is_expert: bool) -> int:
    """Return the tick from which on samples of a CAV are left out.

    An expert that drives: 4 s before its first infraction, and when it moves for the last time if it does not arrive.
    A learner that drives: its first collision, because what the expert would do before is what it has to learn.
    """
    column = episode.ego_ids.index(record.id)
    events = [event for event in record.infractions if event.factor < 1.0 and event.kind != SHARE_OF_WAY]
    if not is_expert:
        collisions = [event.tick for event in events if event.kind.startswith("collision")]
        return min(collisions, default=record.ending.tick + 1)
    end = min((event.tick - BEFORE_FAILURE_TICKS for event in events), default=record.ending.tick + 1)
    if record.ending.end is not End.ARRIVED:
        moving = np.flatnonzero(np.abs(episode.speed[:, column]) > MOVING_SPEED)
        end = min(end, int(moving[-1]) if len(moving) else 0)
    return end
