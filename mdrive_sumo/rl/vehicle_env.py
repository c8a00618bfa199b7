"""VehicleEnv: one CAV learns, a built-in agent drives the others (Gymnasium)."""

from typing import Any, Unpack, cast

import gymnasium

from mdrive_sumo.rl.action_spaces import AnyObservation
from mdrive_sumo.rl.env_arguments import EnvArguments
from mdrive_sumo.rl.parallel_env import ParallelDrivingEnv

OTHERS = "idm"
"""Drives the other CAVs by default: it keeps its distance, and needs no messages."""
LEARNER = "cav_0"
"""The only agent of the environment underneath."""


class VehicleEnv(gymnasium.Env[AnyObservation, Any]):
    """A Gymnasium environment. It does not reset itself: `reset` is the caller's."""

    metadata: dict[str, Any] = {  # noqa: RUF012 - as Gymnasium has it
        "name": "mdrive/interdrive-v0",
        "render_modes": [],
        "autoreset_mode": gymnasium.vector.AutoresetMode.DISABLED,
    }

    def __init__(self, *, own_process: bool = True, **arguments: Unpack[EnvArguments]) -> None:
        """See `ParallelDrivingEnv`; `others` is `idm` unless given, `learner` the place of the CAV that learns."""
        filled = cast(EnvArguments, {"others": OTHERS, **arguments})
        self._env = ParallelDrivingEnv(own_process=own_process, **filled)
        self.observation_space = cast(Any, self._env.observation_space(LEARNER))
        self.action_space = self._env.action_space(LEARNER)

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[AnyObservation, dict[str, Any]]:
        """See `ParallelDrivingEnv.reset`."""
        super().reset(seed=seed)
        observations, infos = self._env.reset(seed, options)
        return observations[LEARNER], infos[LEARNER]

    def step(self, action: Any) -> tuple[AnyObservation, float, bool, bool, dict[str, Any]]:
        """See `ParallelDrivingEnv.step`. After the CAV of the learner ended, the others drive no further."""
        observations, rewards, terminated, truncated, infos = self._env.step({LEARNER: action})
        return observations[LEARNER], rewards[LEARNER], terminated[LEARNER], truncated[LEARNER], infos[LEARNER]

    def close(self) -> None:
        """End the simulation and its process."""
        self._env.close()
