"""The tick: judge, deliver, sense, ask, post, move, step, record. See `EpisodeSimulation` and `run_episode`.

`open_world` is imported from its module: it loads libsumo, which the challenge server must not.
"""

from mdrive_sumo.loop.episode_config import VEHICLE, EpisodeConfig
from mdrive_sumo.loop.episode_runner import run_episode, start_agents
from mdrive_sumo.loop.episode_simulation import EpisodeSimulation
from mdrive_sumo.loop.frame_source import FrameSource, SimulatedFrames, SteppedWorld

__all__ = [
    "VEHICLE",
    "EpisodeConfig",
    "EpisodeSimulation",
    "FrameSource",
    "SimulatedFrames",
    "SteppedWorld",
    "run_episode",
    "start_agents",
]
