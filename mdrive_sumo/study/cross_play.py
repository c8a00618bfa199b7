"""Cross-play: every agent drives one CAV among CAVs of every other agent (ad-hoc cooperation)."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.runs.evaluate import evaluate
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.scoring import Results
from mdrive_sumo.scoring.paired_intervals import bootstrap_results
from mdrive_sumo.study.study_runs import RUNS_FOLDER, StudyProgress, name_agent_folder
from mdrive_sumo.study.two_agents import (
    METRICS,
    TESTED,
    TwoAgentRow,
    list_common_scenarios,
    list_role_results,
    make_two_agent_run,
    tabulate_role,
)

Intervals = Mapping[str, ConfidenceInterval]
"""By metric, DS and SR [%]."""


@dataclass(frozen=True, slots=True)
class CrossPlayStudy:
    """The runs of the study; agents: prepared runs by name."""

    agents: Mapping[str, PreparedRun]
    seeds: tuple[int, ...]
    folder: Path

    def episodes(self) -> int:
        """Return the number of episodes."""
        return len(self.agents) * len(self.seeds) * sum(len(run.scenarios) for run in self.agents.values())

    def rows(self, progress: StudyProgress) -> Iterator[TwoAgentRow]:
        """Drive the unfinished runs and yield a row for each pair. Raises InputError and KeyboardInterrupt."""
        for tested, run in self.agents.items():
            for others, other_run in self.agents.items():
                folder = self.folder / RUNS_FOLDER / name_agent_folder(run.config.agent)
                place = folder / f"among-{name_agent_folder(other_run.config.agent)}"
                results = tuple(self._drive(run, other_run, place, progress))
                yield TwoAgentRow(tested, others, None, results)

    def _drive(self, run: PreparedRun, other: PreparedRun, place: Path, progress: StudyProgress) -> Iterator[Results]:
        for seed in self.seeds:
            progress.run(f"{run.config.agent.name} among {other.config.agent.name}, seed {seed}")
            yield evaluate(make_two_agent_run(run, other, None, seed, place / f"seed{seed}"), progress)


@dataclass(frozen=True, slots=True)
class CrossPlaySummary:
    """The numbers of the study. All scores are those of the CAV under test."""

    agents: tuple[str, ...]
    cells: Mapping[tuple[str, str], Intervals]
    """By agent under test and agent of the others."""
    with_strangers: Mapping[str, Intervals]
    """By agent: the mean over the runs among each other agent."""
    loss: Mapping[str, Intervals]
    """By agent: `with_strangers` minus the score among CAVs of the same agent, paired by scenario and seed."""
    scenarios: int
    void: int
    """Scenarios that are left out because an episode of theirs is void in some run."""


def summarise_cross_play(rows: Sequence[TwoAgentRow]) -> CrossPlaySummary:
    """Return the scores of all pairs; the same scenarios and seeds count everywhere. Raises InputError if none does."""
    names = list_common_scenarios(rows, TESTED)
    if not names:
        raise InputError("study cross-play: expected scenarios that are void in no run, found none")
    agents = tuple(dict.fromkeys(row.agent for row in rows))
    tables = {
        metric: {(row.agent, row.others): tabulate_role(row, names, TESTED, metric) for row in rows}
        for metric in METRICS
    }
    strangers = {
        metric: {a: np.mean([table[a, b] for b in agents if b != a], axis=0) for a in agents}
        for metric, table in tables.items()
    }
    order = list_role_results(rows[0], names)
    return CrossPlaySummary(
        agents,
        {pair: {m: bootstrap_results(tables[m][pair], order) for m in METRICS} for pair in tables[METRICS[0]]},
        {a: {m: bootstrap_results(strangers[m][a], order) for m in METRICS} for a in agents},
        {a: {m: bootstrap_results(strangers[m][a] - tables[m][a, a], order) for m in METRICS} for a in agents},
        len(names),
        len({scenario.id for row in rows for scenario in row.scenarios}) - len(names),
    )
