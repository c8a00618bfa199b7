"""Drives of the hard tier with built-in agents, for the search and for validation."""

from types import MappingProxyType

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.contract.agent_options import Config
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.loop import EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.loop.open_world import open_world
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.variation import vary_scenario
from mdrive_sumo.scoring import ScoreMode, score_episode
from mdrive_sumo.study.occlusion_certificate import REFERENCE_OPTIONS

NO_OPTIONS: Config = MappingProxyType({})


def drive_with(
    agent: str,
    scenario: Scenario,
    roads: RoadMap,
    seed: int = 0,
    options: EpisodeOptions = REFERENCE_OPTIONS,
    agent_config: Config = NO_OPTIONS,
) -> EpisodeRecord:
    """Return the episode of a scenario, as the seed draws it, with a built-in agent in every CAV. Raises WorldError."""
    config = EpisodeConfig(vary_scenario(scenario, roads, seed), roads, seed, options=options)
    drivers = {name: LocalDriver(AGENTS[agent](agent_config)) for name in config.cav_pseudonyms}
    with open_world(config) as world:
        return run_episode(config, world, drivers)


def score_reference(episode: EpisodeRecord, scenario: Scenario, roads: RoadMap, seed: int) -> float:
    """Return the driving score of an episode of a scenario as the seed draws it."""
    return score_episode(episode, vary_scenario(scenario, roads, seed), roads, ScoreMode.MDRIVE, seed).ds
