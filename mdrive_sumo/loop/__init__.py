"""The tick: judge, deliver, sense, ask, post, move, step, record. See `EpisodeSimulation` and `run_episode`."""

from mdrive_sumo.loop.episode_config import VEHICLE, EpisodeConfig
from mdrive_sumo.loop.episode_runner import run_episode
from mdrive_sumo.loop.episode_simulation import EpisodeSimulation, World

__all__ = ["VEHICLE", "EpisodeConfig", "EpisodeSimulation", "World", "run_episode"]
