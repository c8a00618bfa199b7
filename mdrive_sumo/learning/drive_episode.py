"""Drive one training scenario and build its samples."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from mdrive_sumo.core.errors import WorldError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.learning.collection_settings import CollectionSettings
from mdrive_sumo.learning.learner_driver import build_learner
from mdrive_sumo.learning.recording_agent import RecordedDecision, RecordingAgent, RecordingSetup
from mdrive_sumo.learning.sample_files import SampleFiles, encode_sample
from mdrive_sumo.learning.sample_format import CollectedScenario, SampleAbout, format_key
from mdrive_sumo.learning.scene_labels import Labels, SceneLabels
from mdrive_sumo.learning.usable_samples import find_usable_end
from mdrive_sumo.loop import EpisodeConfig, SimulatedFrames, start_agents
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.loop.agent_scheduler import AgentScheduler
from mdrive_sumo.loop.open_world import open_world
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scoring.metrics import build_ego_records


@dataclass(frozen=True)
class CollectedDrive:
    """A finished episode with the decisions of its CAVs, in the order of the scenario file."""

    config: EpisodeConfig
    episode: EpisodeRecord
    decisions: Sequence[Sequence[RecordedDecision]]


def collect_scenario(settings: CollectionSettings, index: int) -> tuple[CollectedScenario, list[SampleFiles]]:
    """Drive the scenario of an index; return what became of it and its samples, CAV by CAV in the order of time.

    A failure of the simulator or of an agent is a status. Raises InputError.
    """
    found = settings.load_scenario(index)
    if found is None:
        return CollectedScenario(index=index, status="none"), []
    scenario, roads = found
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
    sensing_seed = derive_seed(seed, scenario.id, "sensing")
    agents = {ego.id: RecordingAgent(_build_setup(settings, seed, sensing_seed, ego.id)) for ego in scenario.egos}
    drivers = {ego: LocalDriver(agent) for ego, agent in agents.items()}
    with open_world(config) as world:
        simulation = start_agents(config, SimulatedFrames(config, world), drivers)
        scheduler = AgentScheduler(drivers, config.options.clock, (), simulation.fail_agent)
        observations = simulation.reset()
        while not simulation.is_done:
            observations = simulation.step(scheduler.collect_replies(simulation.tick, observations))
            for ego, reason in simulation.failed_agents.items():
                raise WorldError(f"scenario {scenario.id}: the agent of {ego} failed: {reason}")
    episode = simulation.finish()
    return CollectedDrive(config, episode, [agent.decisions for agent in agents.values()])


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
    )


def build_samples(
    settings: CollectionSettings, drive: CollectedDrive, episode_name: str
) -> tuple[list[SampleFiles], int]:
    """Return the samples of a drive, and the number of decisions that are left out, see `find_usable_end`."""
    scenario, episode = drive.config.scenario, drive.episode
    records = build_ego_records(episode, scenario, drive.config.roads)
    ends = [find_usable_end(record, episode, settings.driver is None) for record in records]
    kept = [[one for one in found if one.tick < end] for found, end in zip(drive.decisions, ends, strict=True)]
    scenes = _build_scenes(drive, kept)
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


def _build_scenes(
    drive: CollectedDrive, kept: Sequence[Sequence[RecordedDecision]]
) -> Mapping[tuple[int, int], Labels]:
    """Return the true labels by CAV and tick."""
    labels = SceneLabels(drive.episode, drive.config.roads)
    cavs_by_tick: dict[int, list[int]] = {}
    for cav, decisions in enumerate(kept):
        for one in decisions:
            cavs_by_tick.setdefault(one.tick, []).append(cav)
    return {
        (cav, tick): found
        for tick in sorted(cavs_by_tick)
        for cav, found in labels.build(tick, cavs_by_tick[tick]).items()
    }
