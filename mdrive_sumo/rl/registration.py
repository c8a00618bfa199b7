"""Registers the environments by name: `pettingzoo.make("parallel", ENV_ID)`, `gymnasium.make(ENV_ID)`."""

import gymnasium
import pettingzoo

ENV_ID = "mdrive/interdrive-v0"


def register_environments() -> None:
    """Register the environments. Call it once."""
    pettingzoo.register("parallel", ENV_ID, entry_point="mdrive_sumo.rl.parallel_env:ParallelDrivingEnv")
    gymnasium.register(ENV_ID, entry_point="mdrive_sumo.rl.vehicle_env:VehicleEnv")
