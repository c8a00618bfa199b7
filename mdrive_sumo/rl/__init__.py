"""Environments for reinforcement learning (extra `rl`).

Importing this package registers `mdrive/interdrive-v0` with PettingZoo and Gymnasium. Raises InputError if they are
missing.
"""

from mdrive_sumo.rl.require_gymnasium import require_gymnasium

require_gymnasium()

from mdrive_sumo.rl.parallel_env import ParallelDrivingEnv  # noqa: E402 - the sentence above comes first
from mdrive_sumo.rl.registration import register_environments  # noqa: E402
from mdrive_sumo.rl.training_suite import write_training_suite  # noqa: E402
from mdrive_sumo.rl.vector_env import VectorDrivingEnv  # noqa: E402
from mdrive_sumo.rl.vehicle_env import VehicleEnv  # noqa: E402

register_environments()

__all__ = ["ParallelDrivingEnv", "VectorDrivingEnv", "VehicleEnv", "write_training_suite"]
