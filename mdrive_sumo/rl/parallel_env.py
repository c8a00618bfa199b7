"""ParallelDrivingEnv: all CAVs of a scenario learn (PettingZoo)."""

from collections.abc import Mapping
from typing import Any, ClassVar, Unpack

from gymnasium import spaces
from pettingzoo import ParallelEnv

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.rl.action_spaces import (
    AnyObservation,
    join_observation,
    make_action_space,
    make_observation_space,
    write_action,
)
from mdrive_sumo.rl.env_arguments import EnvArguments, read_settings
from mdrive_sumo.rl.env_settings import EpisodeChoice
from mdrive_sumo.rl.episode_process import EpisodeProcess, Episodes, LocalEpisodes
from mdrive_sumo.rl.observation_page import render_observation_page
from mdrive_sumo.rl.slot_arrays import SlotStatus
from mdrive_sumo.runs.run_config import read_seed

Observations = dict[str, AnyObservation]
Infos = dict[str, dict[str, Any]]


class ParallelDrivingEnv(ParallelEnv[str, AnyObservation, Any]):
    """A PettingZoo environment: agents `cav_0`, `cav_1`, ... are the CAVs in the order of the scenario file.

    A step is a decision. A CAV that ends is terminated and never comes back; a step gives results of all agents that
    were alive before it. The rewards of an episode add up to the driving score, see `driving_reward`; `infos` of the
    first observation name scenario, seed and CAV, those of the last step of an episode hold the scores of the agents
    that ended in it, and under `scores` those of all.
    """

    metadata: dict[str, Any] = {"name": "mdrive/interdrive-v0", "render_modes": []}  # noqa: RUF012 - as PettingZoo has it
    render_mode: ClassVar[None] = None

    def __init__(
        self, *, max_cycles: int | None = None, own_process: bool = True, **arguments: Unpack[EnvArguments]
    ) -> None:
        """max_cycles: decisions after which an episode is given up; None: the protocol ends it.

        own_process: whether the simulation runs in a process of its own. A process can hold only one: False is for
        frameworks that give each environment a process. Other arguments: see EnvSettings. Raises InputError.
        """
        self.settings = read_settings(arguments)
        self.max_cycles = max_cycles
        self.possible_agents = [f"cav_{slot}" for slot in range(self.settings.slots)]
        self.agents: list[str] = []
        self._slot_by_agent = {agent: slot for slot, agent in enumerate(self.possible_agents)}
        self._observation_spaces = {agent: make_observation_space(self.settings) for agent in self.possible_agents}
        self._action_spaces = {agent: make_action_space(self.settings) for agent in self.possible_agents}
        self._own_process = own_process
        self._episodes: Episodes | None = None
        self._seed, self._number, self._cycles = 0, 0, 0
        self._episode = EpisodeChoice("", 0, "")
        """The latest one."""

    def observation_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's observations, the same object at each call."""
        return self._observation_spaces[agent]

    def action_space(self, agent: str) -> spaces.Space[Any]:
        """Return the space of an agent's actions, the same object at each call."""
        return self._action_spaces[agent]

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Observations, Infos]:
        """Start the next episode of the seed; its first one, if a seed is given. Without any the seed is 0.

        options: `scenario`, `scenario_seed`: which one instead. Raises InputError, WorldError and LostProcessError.
        """
        if seed is not None:
            self._seed, self._number = read_seed(seed), 0
        self._episode = episode = self.settings.choose_episode(self._seed, self._number, options or {})
        self._number += 1
        self._cycles = 0
        if self._episodes is None:
            self._episodes = EpisodeProcess(self.settings) if self._own_process else LocalEpisodes(self.settings)
        infos = self._episodes.reset(episode)
        self.agents = [self.possible_agents[slot] for slot in infos]
        return self._collect_observations(), {self.possible_agents[slot]: info for slot, info in infos.items()}

    def step(
        self, actions: Mapping[str, Any]
    ) -> tuple[Observations, dict[str, float], dict[str, bool], dict[str, bool], Infos]:
        """Drive one decision. A CAV without an action repeats its last control.

        Raises InputError for an action that is not in its space, or of an agent that has ended.
        """
        if self._episodes is None or not self.agents:
            raise InputError("step: expected an episode that runs, found none; reset() starts one")
        arrays = self._episodes.arrays
        arrays.asked[:] = 0
        for agent, action in actions.items():
            if agent not in self.agents:
                raise InputError(
                    f"step: expected actions of {', '.join(self.agents)}, found {agent!r:.40}: {self._why(agent)}"
                )
            write_action(self.settings, action, self._slot_by_agent[agent], arrays, agent)
        scores = self._episodes.step()
        self._cycles += 1
        is_given_up = self.max_cycles is not None and self._cycles >= self.max_cycles
        observations = self._collect_observations()
        rewards: dict[str, float] = {}
        terminated: dict[str, bool] = {}
        infos: Infos = {}
        for agent in self.agents:
            slot = self._slot_by_agent[agent]
            rewards[agent] = float(arrays.rewards[slot])
            terminated[agent] = bool(arrays.status[slot] == SlotStatus.TERMINATED)
            infos[agent] = dict(scores.get(slot, {}))
        if scores:
            by_agent = {self.possible_agents[slot]: score for slot, score in scores.items()}
            for info in infos.values():
                info["scores"] = by_agent
        truncated = {agent: is_given_up and not ended for agent, ended in terminated.items()}
        self.agents = [agent for agent in self.agents if not terminated[agent] and not truncated[agent]]
        return observations, rewards, terminated, truncated, infos

    def obs_html(self, agent: str) -> str:
        """Return a page that shows what a living agent sees now. Raises InputError for another one."""
        if self._episodes is None or agent not in self.agents:
            raise InputError(f"obs_html: expected one of {', '.join(self.agents) or 'no agents'}, found {agent!r:.40}")
        arrays, slot, episode = self._episodes.arrays, self._slot_by_agent[agent], self._episode
        tick = self._cycles * self.settings.ticks_per_decision
        facts = (
            ("Scenario", f"{episode.scenario} of {episode.suite}"),
            ("Seed", str(episode.seed)),
            ("Tick", f"{tick}, {tick / TICKS_PER_SECOND:.2f} s"),
            ("View", self.settings.view),
        )
        title = f"What {agent} sees"
        return render_observation_page(self.settings, title, facts, arrays.observations[slot], arrays.grids[slot])

    def render(self) -> None:
        """Draw nothing: `mdrive-sumo view` shows episodes."""

    def close(self) -> None:
        """End the simulation and its process."""
        if self._episodes is not None:
            self._episodes.close()
            self._episodes = None
        self.agents = []

    def _collect_observations(self) -> Observations:
        assert self._episodes is not None
        arrays, slots = self._episodes.arrays, self._slot_by_agent
        return {
            agent: join_observation(arrays.observations[slots[agent]].copy(), arrays.grids[slots[agent]].copy())
            for agent in self.agents
        }

    def _why(self, agent: object) -> str:
        return "it has ended" if agent in self._slot_by_agent else "no such agent"
