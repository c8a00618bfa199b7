"""The tick: judge, deliver, sense, ask, post, move, step, record. See `EpisodeSimulation` and `run_episode`."""

from mdrive_sumo.loop.episode_config import VEHICLE, EpisodeConfig, EpisodeOptions
from mdrive_sumo.loop.episode_runner import run_episode
from mdrive_sumo.loop.episode_simulation import EpisodeSimulation, World
from mdrive_sumo.loop.open_world import open_world

__all__ = ["VEHICLE", "EpisodeConfig", "EpisodeOptions", "EpisodeSimulation", "World", "open_world", "run_episode"]
