"""One drive of a scenario as written with a built-in agent, in this process."""

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.loop import VEHICLE, EpisodeConfig, run_episode
from mdrive_sumo.loop.agent_driver import LocalDriver
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.study.occlusion_certificate import REFERENCE_OPTIONS
from mdrive_sumo.sumo import SumoWorld

SEED = 0
"""The scenario as written."""


def drive_episode(scenario: Scenario, roads: RoadMap, agent: str) -> EpisodeRecord:
    """Return an episode with a built-in agent; raises WorldError."""
    sizes = {ego.id: (VEHICLE.length, VEHICLE.width) for ego in scenario.egos}
    drivers = {ego.id: LocalDriver(AGENTS[agent]({})) for ego in scenario.egos}
    with SumoWorld(scenario, roads, sizes, derive_seed(SEED, scenario.id, "sumo")) as world:
        return run_episode(EpisodeConfig(scenario, roads, SEED, options=REFERENCE_OPTIONS), world, drivers)
