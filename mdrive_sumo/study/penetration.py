"""Penetration: what it is worth that only a share of the CAVs is connected, the others driving by themselves."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.statistics import ConfidenceInterval
from mdrive_sumo.runs.evaluate import evaluate
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.scoring import Results
from mdrive_sumo.scoring.paired_intervals import bootstrap_results
from mdrive_sumo.scoring.roles import mark_tested
from mdrive_sumo.study.study_runs import RUNS_FOLDER, StudyProgress, make_variant, name_agent_folder
from mdrive_sumo.study.two_agents import (
    ALL,
    METRICS,
    ROLES,
    TwoAgentRow,
    list_common_scenarios,
    list_role_results,
    make_two_agent_run,
    tabulate_role,
)

LEVELS = (25, 50, 75)
"""[%] Shares of CAVs under test by default, between the ends of the scale."""
NONE, EVERY = 0, 100
"""The ends of the scale [%], which are always driven: only the others, only the agent under test."""


@dataclass(frozen=True, slots=True)
class PenetrationStudy:
    """The runs of the study; agents: prepared runs by name."""

    agents: Mapping[str, PreparedRun]
    others: PreparedRun
    """The agent of the CAVs that are not connected."""
    levels: tuple[int, ...]
    """Percentages of CAVs under test between 0 and 100, ascending."""
    seeds: tuple[int, ...]
    folder: Path

    def episodes(self) -> int:
        """Return the number of episodes."""
        runs = 1 + len(self.agents) * (len(self.levels) + 1)
        return runs * len(self.seeds) * len(self.others.scenarios)

    def rows(self, progress: StudyProgress) -> Iterator[TwoAgentRow]:
        """Drive the unfinished runs and yield a row for each agent and level. Raises InputError, KeyboardInterrupt."""
        unconnected = tuple(self._drive(self.others, NONE, progress))
        for name, run in self.agents.items():
            others = self.others.config.agent.name
            yield TwoAgentRow(name, others, NONE, unconnected)
            for level in (*self.levels, EVERY):
                yield TwoAgentRow(name, others, level, tuple(self._drive(run, level, progress)))

    def _drive(self, run: PreparedRun, level: int, progress: StudyProgress) -> Iterator[Results]:
        folder = self.folder / RUNS_FOLDER / name_agent_folder(run.config.agent) / f"{level}-percent"
        for seed in self.seeds:
            progress.run(f"{run.config.agent.name}, {EVERY if run is self.others else level} %, seed {seed}")
            place = folder / f"seed{seed}"
            if level in (NONE, EVERY):
                yield evaluate(make_variant(run, run.config.options, (seed,), place), progress)
            else:
                yield evaluate(make_two_agent_run(run, self.others, level, seed, place), progress)


@dataclass(frozen=True, slots=True)
class PenetrationLine:
    """An agent at a penetration."""

    agent: str
    penetration: int
    scenarios: int
    score: Mapping[str, Mapping[str, ConfidenceInterval]]
    """By role and metric; without the roles that no CAV has at this penetration."""
    difference: Mapping[str, ConfidenceInterval]
    """All CAVs against penetration 0, paired by scenario and seed, by metric."""


@dataclass(frozen=True, slots=True)
class PenetrationSummary:
    """The numbers of the study."""

    lines: tuple[PenetrationLine, ...]
    void: int
    """Scenarios that are left out because an episode of theirs is void in some run."""


def summarise_penetration(rows: Sequence[TwoAgentRow]) -> PenetrationSummary:
    """Return a line for each agent and level; scenarios that are void somewhere count nowhere.

    A role counts over the scenarios that have CAVs of it at that level. Raises InputError if every scenario is void.
    """
    names = list_common_scenarios(rows)
    if not names:
        raise InputError("study penetration: expected scenarios that are void in no run, found none")
    base = {row.agent: row for row in rows if row.penetration == NONE}
    lines = tuple(_summarise(_mark_ends(row), base[row.agent], names) for row in rows)
    return PenetrationSummary(lines, len({scenario.id for row in rows for scenario in row.scenarios}) - len(names))


def _mark_ends(row: TwoAgentRow) -> TwoAgentRow:
    """Return the row of penetration 0 with every CAV marked as one of the others, which drove them all."""
    if row.penetration != NONE:
        return row
    results = tuple(
        results.model_copy(update={"scenarios": tuple(mark_tested(scenario, ()) for scenario in results.scenarios)})
        for results in row.results
    )
    return replace(row, results=results)


def _summarise(row: TwoAgentRow, base: TwoAgentRow, names: Sequence[str]) -> PenetrationLine:
    assert row.penetration is not None, "a row of this study"
    by_role = {role: [name for name in list_common_scenarios([row], role) if name in names] for role in ROLES}
    score = {
        role: {
            metric: bootstrap_results(tabulate_role(row, members, role, metric), list_role_results(row, members))
            for metric in METRICS
        }
        for role, members in by_role.items()
        if members
    }
    difference = {
        metric: bootstrap_results(
            tabulate_role(row, names, ALL, metric) - tabulate_role(base, names, ALL, metric),
            list_role_results(row, names),
        )
        for metric in METRICS
    }
    return PenetrationLine(row.agent, row.penetration, len(names), score, difference)
