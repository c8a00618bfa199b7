"""Connect an episode's configuration to the simulator."""

from typing import TYPE_CHECKING

from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.loop.episode_config import VEHICLE, EpisodeConfig

if TYPE_CHECKING:
    from mdrive_sumo.sumo import SumoWorld


def open_world(config: EpisodeConfig) -> "SumoWorld":
    """Return the SUMO world of an episode, not started yet: a context manager that starts and closes it."""
    from mdrive_sumo.sumo import SumoWorld  # only here: a third of a second, and most processes drive no episode

    scenario = config.scenario
    dimensions = {ego.id: (VEHICLE.length, VEHICLE.width) for ego in scenario.egos}
    seed = derive_seed(config.seed, scenario.id, "sumo")
    return SumoWorld(scenario, config.roads, dimensions, seed, config.road_grip)
