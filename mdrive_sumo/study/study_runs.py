"""The runs of a channel study, each a run folder that can be continued, and the references of captured cooperation."""

import hashlib
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from mdrive_sumo.core.clock import IDEAL
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.evaluate import Progress, evaluate
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scoring import Results, ScenarioResult
from mdrive_sumo.scoring.captured_cooperation import CapturedCooperation, compute_captured_cooperation
from mdrive_sumo.study.conditions import ChannelCondition
from mdrive_sumo.v2x.attacks.attack_settings import NO_ATTACK
from mdrive_sumo.v2x.comm_settings import PRESETS

RUNS_FOLDER = "runs"
BEST = "omniscient"
"""The agent with perfect cooperation."""
Evaluate = Callable[[PreparedRun], Results]


class StudyProgress(Progress, Protocol):
    """Receives the progress of a study."""

    def run(self, name: str) -> None:
        """A run begins."""
        ...

    def spared(self, scenarios: int) -> None:
        """A number of episodes need not be driven."""
        ...


@dataclass(frozen=True, slots=True)
class Study:
    """The runs of a study. agents: by name, prepared with the base channel and the first seed."""

    agents: Mapping[str, PreparedRun]
    best: PreparedRun | None
    """The omniscient agent, for captured cooperation; None without it."""
    conditions: tuple[ChannelCondition, ...]
    """The channels that are driven, the base condition first."""
    off: ChannelCondition | None
    """The channel that is off, the reference for captured cooperation; None without it."""
    seeds: tuple[int, ...]
    folder: Path

    def episodes(self) -> int:
        """Return the largest possible number of episodes."""
        whole = [len(run.scenarios) * len(self._all_conditions()) for run in self.agents.values()]
        reference = len(self.best.scenarios) if self.best and BEST not in self.agents else 0
        return (sum(whole) + reference) * len(self.seeds)

    def _all_conditions(self) -> tuple[ChannelCondition, ...]:
        base, *others = self.conditions
        return (base, *([self.off] if self.off else ()), *others)

    def rows(self, progress: StudyProgress) -> Iterator["StudyRow"]:
        """Drive the unfinished runs and yield the rows. Raises InputError and KeyboardInterrupt."""
        for name, prepared in self.agents.items():
            yield from self._drive_agent(name, prepared, progress)
        if self.best and BEST not in self.agents:
            yield self._drive_row(BEST, self.best, self.conditions[0], progress)

    def _drive_agent(self, name: str, prepared: PreparedRun, progress: StudyProgress) -> Iterator["StudyRow"]:
        base, *others = self._all_conditions()
        first = self._drive_row(name, prepared, base, progress)
        yield first
        if not is_silent(first):
            for condition in others:
                yield self._drive_row(name, prepared, condition, progress)
            return
        progress.note(f"{name} sends no messages: its base runs stand for all conditions")
        progress.spared(len(others) * len(self.seeds) * len(prepared.scenarios))
        for condition in others:
            yield replace(first, condition=condition, reused=True)

    def _drive_row(
        self, name: str, prepared: PreparedRun, condition: ChannelCondition, progress: StudyProgress
    ) -> "StudyRow":
        results: list[Results] = []
        for seed in self.seeds:
            run = _prepare_cell(prepared, condition, seed, self.folder / RUNS_FOLDER)
            progress.run(f"{name}, {condition.name}, seed {seed}")
            results.append(evaluate(run, progress))
        return StudyRow(name, condition, tuple(results), reused=False)


@dataclass(frozen=True, slots=True)
class StudyRow:
    """One agent in one condition, with the results of every seed."""

    agent: str
    condition: ChannelCondition
    results: tuple[Results, ...]
    reused: bool
    """Whether these are the results of the base condition, because the agent sends no messages."""

    @property
    def scenarios(self) -> tuple[ScenarioResult, ...]:
        """The scenarios of all seeds."""
        return tuple(scenario for results in self.results for scenario in results.scenarios)


def is_silent(row: StudyRow) -> bool:
    """Return whether no scenario has a message, so that no channel makes a difference; False if one is void."""
    return all(scenario.status == "ok" and not scenario.comm for scenario in row.scenarios)


def _prepare_cell(prepared: PreparedRun, condition: ChannelCondition, seed: int, folder: Path) -> PreparedRun:
    """Return the run of one agent in one condition with one seed."""
    options = prepared.config.options.with_channel(condition.comm)
    agent_folder = folder / name_agent_folder(prepared.config.agent)
    return make_variant(prepared, options, (seed,), agent_folder / condition.folder / f"seed{seed}")


def make_variant(prepared: PreparedRun, options: EpisodeOptions, seeds: tuple[int, ...], folder: Path) -> PreparedRun:
    """Return a prepared run with other options, other seeds and another folder."""
    return prepared.with_config(replace(prepared.config, options=options, seeds=seeds, out=folder))


def name_agent_folder(agent: AgentSpec) -> str:
    """Return an agent's folder; that of a third-party agent has a checksum, for two classes may have one name."""
    if agent.is_builtin:
        return agent.name
    checksum = hashlib.sha256(agent.resolve().name.encode()).hexdigest()[:6]
    return re.sub(r"[^A-Za-z0-9_.+-]+", "_", re.sub(r"^.*/|\.py(?=:)", "", agent.name)) + "-" + checksum


def make_reference_configs(config: RunConfig) -> tuple[RunConfig, RunConfig]:
    """Return the same agent with the channel off, and omniscient: suite, scenarios, seed and score mode of `config`.

    Both are honest: without messages there are no lies, and the omniscient agent reads none.
    They have no `out`, so they lie where `eval` puts them by default: one reference serves many runs. `fresh` does
    not reach them.
    """
    own = replace(config, out=None, fresh=False)
    honest = replace(own.options, attack=NO_ATTACK)
    off = replace(own, options=replace(honest, comm=PRESETS["off"]))
    best = replace(own, agent=AgentSpec(BEST), options=replace(honest, comm=PRESETS["ideal"], clock=IDEAL))
    return off, best


def evaluate_captured_cooperation(results: Results, config: RunConfig, evaluate: Evaluate) -> CapturedCooperation:
    """Return the captured cooperation of a finished run; `evaluate` drives the references unless they are finished.

    Raises InputError, and what `evaluate` raises.
    """
    try:
        off, best = (evaluate(prepare(reference)) for reference in make_reference_configs(config))
    except InputError as error:
        problem, stale, _ = str(error).partition("; --fresh")
        mend = "; remove that folder to have it driven anew" if stale else ""
        raise InputError(f"reference for captured cooperation: {problem}{mend}") from None
    return compute_captured_cooperation(results, off, best)
