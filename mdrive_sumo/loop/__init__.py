"""The tick: judge, deliver, sense, ask, post, move, step, record. See `EpisodeSimulation` and `run_episode`.

`open_world` is imported from its module: it loads libsumo, which the challenge server must not.
"""

from mdrive_sumo.loop.episode_config import VEHICLE, EpisodeConfig, EpisodeOptions
from mdrive_sumo.loop.episode_runner import run_episode
from mdrive_sumo.loop.episode_simulation import EpisodeSimulation, World

__all__ = ["VEHICLE", "EpisodeConfig", "EpisodeOptions", "EpisodeSimulation", "World", "run_episode"]
