"""What lying senders cost: agents under each attack, with and without their defence, beside an agent that is alone."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.runs.evaluate import EpisodeExecutor, evaluate, make_episode_executor
from mdrive_sumo.runs.prepared_run import PreparedRun, check_attack
from mdrive_sumo.scoring import Results, ScenarioResult
from mdrive_sumo.scoring.paired_intervals import ResultTable, bootstrap_results, group_by_scenario, list_results
from mdrive_sumo.study.study_runs import RUNS_FOLDER, StudyProgress, make_variant, name_agent_folder
from mdrive_sumo.v2x.attacks.attack_settings import NO_ATTACK

ATTACKS = ("phantom", "hide", "shift", "forge-mcm", "forge-mcm:claim=yield", "replay", "flood")
"""The attacks by default: every kind, by one CAV of each scenario, and both claims of forged MCMs."""
METRICS = ("ds", "sr")
UNDEFENDED: Mapping[str, float] = {"defence": 0}
"""Options of an agent that has a defence, to drive without it."""


@dataclass(frozen=True, slots=True)
class AttackedAgent:
    """An agent as the study drives it, prepared without an attack."""

    name: str
    has_defence: bool | None
    """Whether its defence is on; None: it has none."""
    run: PreparedRun

    @property
    def folder(self) -> str:
        """Name of the folder of its runs."""
        return name_agent_folder(self.run.config.agent) + ("-undefended" if self.has_defence is False else "")


@dataclass(frozen=True, slots=True)
class AttackRow:
    """An agent under an attack, with the results of every seed."""

    agent: str
    has_defence: bool | None
    attack: str
    """As `--attack` writes it; `NO_ATTACK` for honest runs."""
    results: tuple[Results, ...]

    @property
    def scenarios(self) -> tuple[ScenarioResult, ...]:
        """The scenarios of all seeds."""
        return tuple(scenario for results in self.results for scenario in results.scenarios)


@dataclass(frozen=True, slots=True)
class AttackStudy:
    """The runs of the study."""

    alone: AttackedAgent
    """The agent beside which all others stand; it reads no messages, so that it is driven without attacks only."""
    agents: tuple[AttackedAgent, ...]
    attacks: tuple[str, ...]
    seeds: tuple[int, ...]
    folder: Path

    def check(self) -> None:
        """Raise InputError for attacks by stations that the scenarios do not have."""
        run = self.alone.run
        for attack in self.attacks:
            options = replace(run.config.options, attack=attack)
            check_attack(replace(run.config, options=options), run.scenarios)

    def episodes(self) -> int:
        """Return the number of episodes."""
        runs = 1 + len(self.agents) * (1 + len(self.attacks))
        return runs * len(self.seeds) * len(self.alone.run.scenarios)

    def rows(self, progress: StudyProgress) -> Iterator[AttackRow]:
        """Drive the unfinished runs and yield a row for each. Raises InputError and KeyboardInterrupt.

        All runs share worker processes, which keep the networks that they have loaded.
        """
        limit_s = max(agent.run.limit_s() for agent in (self.alone, *self.agents))
        with make_episode_executor(self.alone.run.config.workers, limit_s) as executor:
            yield self._drive(self.alone, NO_ATTACK, progress, executor)
            for agent in self.agents:
                for attack in (NO_ATTACK, *self.attacks):
                    yield self._drive(agent, attack, progress, executor)

    def _drive(
        self, agent: AttackedAgent, attack: str, progress: StudyProgress, executor: EpisodeExecutor
    ) -> AttackRow:
        options = replace(agent.run.config.options, attack=attack)
        place = self.folder / RUNS_FOLDER / agent.folder / options.attack.replace(":", "-").replace("=", "-")
        results: list[Results] = []
        for seed in self.seeds:
            progress.run(f"{agent.name}{describe_defence(agent.has_defence)}, attack {attack}, seed {seed}")
            run = make_variant(agent.run, options, (seed,), place / f"seed{seed}")
            results.append(evaluate(run, progress, executor))
        return AttackRow(agent.name, agent.has_defence, options.attack, tuple(results))


def describe_defence(has_defence: bool | None) -> str:
    """Return what follows the name of an agent."""
    return "" if has_defence is None else " with defence" if has_defence else " without defence"


@dataclass(frozen=True, slots=True)
class AttackLine:
    """The scores [%] of an agent under an attack, and paired differences [points], by metric."""

    agent: str
    has_defence: bool | None
    attack: str
    score: Mapping[str, ConfidenceInterval]
    to_alone: Mapping[str, ConfidenceInterval] | None
    """To the agent that is alone; None for itself."""
    to_honest: Mapping[str, ConfidenceInterval] | None
    """To the same agent with the same defence and honest senders; None for honest runs."""
    to_undefended: Mapping[str, ConfidenceInterval] | None
    """Of a defended agent to the same without its defence, under the same attack."""


@dataclass(frozen=True, slots=True)
class AttackSummary:
    """The numbers of the study."""

    lines: tuple[AttackLine, ...]
    scenarios: int
    void: int
    """Scenarios that are left out because an episode of theirs is void in some run."""


def summarise_attacks(rows: Sequence[AttackRow]) -> AttackSummary:
    """Return a line for each row; the first row is that of the agent that is alone.

    Scenarios that are void somewhere count nowhere. Raises InputError if every scenario is.
    """
    tables = [group_by_scenario(row.scenarios) for row in rows]
    names = list(dict.fromkeys(scenario.id for row in rows for scenario in row.scenarios))
    common = [name for name in names if all(name in table for table in tables)]
    if not common:
        raise InputError("study attacks: expected scenarios that are void in no run, found none")
    table_by_key = {(row.agent, row.has_defence, row.attack): table for row, table in zip(rows, tables, strict=True)}
    lines = tuple(_summarise(row, table_by_key, tables[0], common) for row in rows)
    return AttackSummary(lines, len(common), len(names) - len(common))


def _summarise(
    row: AttackRow,
    table_by_key: Mapping[tuple[str, bool | None, str], ResultTable],
    alone: ResultTable,
    names: Sequence[str],
) -> AttackLine:
    table = table_by_key[row.agent, row.has_defence, row.attack]
    honest = table_by_key[row.agent, row.has_defence, NO_ATTACK]
    undefended = table_by_key.get((row.agent, False, row.attack)) if row.has_defence else None
    return AttackLine(
        row.agent,
        row.has_defence,
        row.attack,
        score=_bootstrap(table, None, names),
        to_alone=None if table is alone else _bootstrap(table, alone, names),
        to_honest=None if row.attack == NO_ATTACK else _bootstrap(table, honest, names),
        to_undefended=None if undefended is None else _bootstrap(table, undefended, names),
    )


def _bootstrap(table: ResultTable, base: ResultTable | None, names: Sequence[str]) -> dict[str, ConfidenceInterval]:
    """Return the interval of a score, or of its difference to a base, paired by scenario and seed, by metric."""
    results = list_results(table, names)
    others = None if base is None else list_results(base, names)
    intervals: dict[str, ConfidenceInterval] = {}
    for metric in METRICS:
        values = np.array([getattr(one, metric) for one in results])
        if others is not None:
            values = values - np.array([getattr(one, metric) for one in others])
        intervals[metric] = bootstrap_results(values, results)
    return intervals
