"""VectorDrivingEnv: many scenarios at once in worker processes (Gymnasium's VectorEnv)."""

import warnings
from typing import Any, Unpack, cast

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.seeding import derive_seed
from mdrive_sumo.rl.action_spaces import (
    CONTROL,
    MESSAGE,
    AnyObservation,
    join_observation,
    make_action_space,
    make_observation_space,
    write_action,
)
from mdrive_sumo.rl.env_arguments import EnvArguments, read_settings
from mdrive_sumo.rl.env_settings import EpisodeChoice
from mdrive_sumo.rl.episode_process import EpisodeProcess, LostProcessError, serve_episodes
from mdrive_sumo.rl.episode_stepper import SlotInfo
from mdrive_sumo.rl.slot_arrays import SlotStatus
from mdrive_sumo.runs.fork_server import ForkServer
from mdrive_sumo.runs.run_config import read_seed

MOST_WORKERS = 512


class VectorDrivingEnv(VectorEnv[AnyObservation, Any, np.ndarray]):
    """`workers` processes with `settings.slots` learners each: environment `worker * slots + slot` is one learner.

    A learner whose CAV ended rests until the episode of its worker is over: `infos["is_active"]` (num_envs,) tells
    which rows of a step count. A worker whose episode is over begins the next one in the same step (SAME_STEP): the
    observations are its first, and `infos["scores"]` maps environments to the scores of the episode that is over. Each
    worker has a seed of its own, so neither their number nor their order changes what one of them drives.
    """

    metadata: dict[str, Any] = {"render_modes": [], "autoreset_mode": AutoresetMode.SAME_STEP}  # noqa: RUF012

    def __init__(self, workers: int, **arguments: Unpack[EnvArguments]) -> None:
        """See EnvSettings for the arguments. Raises InputError."""
        if isinstance(workers, bool) or not isinstance(cast(object, workers), int) or not 1 <= workers <= MOST_WORKERS:
            raise InputError(
                f"environment: workers: expected an integer from 1 to {MOST_WORKERS}, found {workers!r:.40}"
            )
        self.settings = read_settings(arguments)
        self.workers, self._slots = workers, self.settings.slots
        self.num_envs = workers * self._slots
        self.single_observation_space = make_observation_space(self.settings)
        self.single_action_space = make_action_space(self.settings)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._server = ForkServer(serve_episodes)
        self._processes: list[EpisodeProcess] = []
        try:
            while len(self._processes) < workers:
                self._processes.append(EpisodeProcess(self.settings, self._server))
        except LostProcessError:
            self.close_extras()
            raise
        self._numbers = [0] * workers
        self._seed = 0

    @property
    def process_ids(self) -> tuple[int, ...]:
        """Of the workers."""
        return tuple(process.process_id for process in self._processes)

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[AnyObservation, dict[str, Any]]:
        """Start an episode in every worker; `seed` is that of all. See `ParallelDrivingEnv.reset` for the options."""
        if seed is not None:
            self._seed, self._numbers = read_seed(seed), [0] * self.workers  # pyright: ignore[reportArgumentType] - a list is refused there
        self._begin_episodes(range(self.workers), options or {})
        return self._stack_observations(), {"is_active": self._stack("status") == SlotStatus.ACTIVE}

    def step(self, actions: Any) -> tuple[AnyObservation, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """Drive one decision in every worker. actions: a batch of `action_space`; those of resting rows are not read.

        Raises InputError. A worker that has died is named by a RuntimeWarning and begins its next episode; its
        learners are truncated.
        """
        self._write_actions(actions)
        lost = [worker for worker, process in enumerate(self._processes) if not _ask_step(process)]
        scores: dict[int, SlotInfo] = {}
        over: list[int] = []
        for worker, process in enumerate(self._processes):
            if worker in lost:
                continue
            try:
                found = process.receive()
            except LostProcessError:
                lost.append(worker)
                continue
            scores |= {worker * self._slots + slot: info for slot, info in found.items()}
            over += [worker] if found else []
        for worker in lost:
            self._restart(worker)
        rewards, status = self._stack("rewards"), self._stack("status")
        self._begin_episodes([*over, *lost], {})
        is_active = self._stack("status") == SlotStatus.ACTIVE
        infos: dict[str, Any] = {"is_active": is_active, "scores": scores, "restarted": tuple(lost)}
        observations = self._stack_observations()
        return observations, rewards, status == SlotStatus.TERMINATED, status == SlotStatus.TRUNCATED, infos

    def close_extras(self, **_: Any) -> None:
        """End all processes."""
        for process in self._processes:
            process.close()
        self._server.end()

    def _write_actions(self, actions: Any) -> None:
        is_talking = self.settings.message_bytes > 0
        columns = [actions[CONTROL], actions[MESSAGE]] if is_talking else [actions]
        if any(len(column) != self.num_envs for column in columns):
            raise InputError(f"step: expected {self.num_envs} actions, found {len(columns[0])}")
        for worker, process in enumerate(self._processes):
            arrays = process.arrays
            arrays.asked[:] = 0
            for slot in np.flatnonzero(arrays.status == SlotStatus.ACTIVE).tolist():
                row = worker * self._slots + slot
                action = {CONTROL: columns[0][row], MESSAGE: columns[1][row]} if is_talking else columns[0][row]
                write_action(self.settings, action, slot, arrays, f"environment {row}")

    def _begin_episodes(self, workers: Any, options: dict[str, Any]) -> None:
        """Start the next episode of each of these workers, all at once."""
        for worker in workers:
            self._processes[worker].send_reset(self._choose_episode(worker, options))
        for worker in workers:
            self._processes[worker].receive()

    def _choose_episode(self, worker: int, options: dict[str, Any]) -> EpisodeChoice:
        number = self._numbers[worker]
        self._numbers[worker] += 1
        return self.settings.choose_episode(derive_seed(self._seed, "rl-worker", str(worker)), number, options)

    def _restart(self, worker: int) -> None:
        lost = self._processes[worker]
        warnings.warn(
            f"environment: worker {worker} (process {lost.process_id}) has died; it begins its next episode",
            RuntimeWarning,
            stacklevel=3,
        )
        was_active = lost.arrays.status == SlotStatus.ACTIVE
        lost.close()
        process = self._processes[worker] = EpisodeProcess(self.settings, self._server)
        process.arrays.status[was_active] = SlotStatus.TRUNCATED

    def _stack_observations(self) -> AnyObservation:
        return join_observation(self._stack("observations"), self._stack("grids"))

    def _stack(self, name: str) -> np.ndarray:
        return np.concatenate([getattr(process.arrays, name) for process in self._processes])


def _ask_step(process: EpisodeProcess) -> bool:
    """Ask for a step; return whether the process could be asked."""
    try:
        process.send_step()
    except LostProcessError:
        return False
    return True
