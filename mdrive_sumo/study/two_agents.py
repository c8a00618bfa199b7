"""Runs of two agents as parts of a study, and the scores of each agent's CAVs, scenario by scenario."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.runs.other_agents import OtherAgents
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.scoring import EgoResult, Results, ScenarioResult
from mdrive_sumo.scoring.paired_intervals import group_by_scenario, list_results
from mdrive_sumo.scoring.score_mode import SUCCESS_DS, compute_mean

DS, SR = "ds", "sr"
METRICS = (DS, SR)
ALL, TESTED, OTHER = "all", "under test", "other"
ROLES = (ALL, TESTED, OTHER)
"""All CAVs of an episode, those of the agent under test, those of the second agent."""


@dataclass(frozen=True, slots=True)
class TwoAgentRow:
    """An agent among others, with the results of every seed."""

    agent: str
    others: str
    penetration: int | None
    """Percentage of CAVs under test, 0 and 100 included; None: one CAV."""
    results: tuple[Results, ...]

    @property
    def scenarios(self) -> tuple[ScenarioResult, ...]:
        """The scenarios of all seeds."""
        return tuple(scenario for results in self.results for scenario in results.scenarios)


def make_two_agent_run(
    tested: PreparedRun, other: PreparedRun, penetration: int | None, seed: int, folder: Path
) -> PreparedRun:
    """Return the run in which the CAVs that `tested` leaves are driven by the agent of `other`. Raises InputError."""
    config = replace(tested.config, others=OtherAgents(other.config.agent, penetration), seeds=(seed,), out=folder)
    labels = tuple(dict.fromkeys((*tested.info.labels, *other.info.labels)))
    return tested.with_config(config, labels)


def list_common_scenarios(rows: Sequence[TwoAgentRow], role: str = ALL) -> list[str]:
    """Return the scenarios that are void in no row and have CAVs of this role in every episode, in their order."""
    tables = [group_by_scenario(row.scenarios) for row in rows]
    names = dict.fromkeys(scenario.id for row in rows for scenario in row.scenarios)
    return [
        name
        for name in names
        if all(name in table and all(_select(result, role) for result in table[name].values()) for table in tables)
    ]


def tabulate_role(row: TwoAgentRow, names: Sequence[str], role: str, metric: str) -> Float:
    """Return DS or SR [%] of the CAVs of a role, (scenarios, seeds): means over these CAVs, each scored alone."""
    table = group_by_scenario(row.scenarios)
    drives = [[_select(result, role) for _, result in sorted(table[name].items())] for name in names]
    return np.array(
        [
            [compute_mean(ego.ds if metric == DS else 100.0 * (ego.ds > SUCCESS_DS) for ego in egos) for egos in seeds]
            for seeds in drives
        ]
    )


def list_role_results(row: TwoAgentRow, names: Sequence[str]) -> list[ScenarioResult]:
    """Return the results whose values `tabulate_role` gives, in its order."""
    return list_results(group_by_scenario(row.scenarios), names)


def _select(result: ScenarioResult, role: str) -> list[EgoResult]:
    return [ego for ego in result.egos if role == ALL or ego.is_other == (role == OTHER)]
