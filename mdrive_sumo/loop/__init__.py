"""The tick: judge, deliver, sense, ask, post, move, step, record. See `run_episode`."""

from mdrive_sumo.loop.simulation import VEHICLE, EpisodeConfig, Surroundings, World, run_episode

__all__ = ["VEHICLE", "EpisodeConfig", "Surroundings", "World", "run_episode"]
