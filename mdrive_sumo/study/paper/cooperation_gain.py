"""What cooperation gains (RQ1, RQ2): multi-agent against single-agent systems, and pairs of agents with one planner."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.statistics import (
    ConfidenceInterval,
    Counts,
    count_effective,
    draw_nested_counts,
    make_interval,
    sum_resamples,
)
from mdrive_sumo.scenario.categories import LEVELS, Category
from mdrive_sumo.scoring import Results, ScenarioResult
from mdrive_sumo.scoring.paired_intervals import (
    ResultTable,
    compute_difference_interval,
    group_by_scenario,
    list_results,
)
from mdrive_sumo.study.paper.paper_agents import AgentRole, select_by_role

ALL = "all"
PAIRS: Mapping[tuple[str, str], str] = {
    ("sharing", "single"): "perception sharing",
    ("sharing+negotiation", "sharing"): "negotiation on top of sharing",
    ("sharing+negotiation", "single"): "both",
    ("colmdriver-rule", "single"): "negotiation by rule, without sharing",
    ("colmdriver", "single"): "negotiation by language model, without sharing",
}
"""Pairs of agents that differ in this and drive with the same planner, so that their difference is its gain."""


@dataclass(frozen=True, slots=True)
class PairGain:
    """The paired difference of two agents over a group of scenarios, in points of DS and SR."""

    agent: str
    base: str
    group: str
    scenarios: int
    ds: ConfidenceInterval
    sr: ConfidenceInterval


@dataclass(frozen=True, slots=True)
class RoleGap:
    """Mean H of the multi-agent systems, that of the single-agent systems, and the difference [points of H]."""

    group: str
    scenarios: int
    multi: float
    single: float
    gap: ConfidenceInterval


def split_groups(scenarios: Sequence[ScenarioResult]) -> dict[str, set[str]]:
    """Return ids of scenarios by bucket, then by interactivity level, then all."""
    groups: dict[str, set[str]] = {}
    for result in scenarios:
        groups.setdefault(result.bucket, set()).add(result.id)
    for result in scenarios:
        if result.category in set(Category):
            groups.setdefault(LEVELS[Category(result.category)], set()).add(result.id)
    return {**groups, ALL: {result.id for result in scenarios}}


def compute_pair_gains(runs: Mapping[str, Results]) -> tuple[PairGain, ...]:
    """Return the gains of `PAIRS` whose agents are both there, by bucket, level and over all scenarios."""
    gains: list[PairGain] = []
    for agent, base in PAIRS:
        if agent not in runs or base not in runs:
            continue
        tables = [group_by_scenario(runs[name].scenarios) for name in (agent, base)]
        for group, names in split_groups(runs[agent].scenarios).items():
            ours, theirs = ({name: results for name, results in table.items() if name in names} for table in tables)
            ds, sr = (compute_difference_interval(ours, theirs, score) for score in ("ds", "sr"))
            if ds and sr:
                gains.append(PairGain(agent, base, group, len({*ours} & {*theirs}), ds, sr))
    return tuple(gains)


def compute_role_gaps(runs: Mapping[str, Results]) -> tuple[RoleGap, ...]:
    """Return the gap of multi-agent and single-agent systems by bucket and level (paper, RQ1); none without both.

    H of an agent is the harmonic mean of its mean DS and SR over a group, as in the paper's category figure. The gap
    is the difference of the means of H over the agents of each role. Intervals are over scenarios, not over agents.
    """
    roles = {role: [*select_by_role(runs, role).values()] for role in (AgentRole.MULTI, AgentRole.SINGLE)}
    if not all(roles.values()):
        return ()
    tables = {id(run): group_by_scenario(run.scenarios) for members in roles.values() for run in members}
    gaps: list[RoleGap] = []
    for group, names in split_groups(next(iter(roles[AgentRole.MULTI])).scenarios).items():
        common = sorted(name for name in names if all(name in table for table in tables.values()))
        if not common:
            continue
        results = list_results(next(iter(tables.values())), common)
        labels = [result.label for result in results]
        counts = draw_nested_counts(labels)
        means = {
            role: np.mean([_compute_harmonic_means(tables[id(run)], common, counts) for run in members], axis=0)
            for role, members in roles.items()
        }
        multi, single = means[AgentRole.MULTI], means[AgentRole.SINGLE]
        places = {label[0] for label in labels}
        gap = make_interval(float(multi[0] - single[0]), (multi - single)[1:], len(places), count_effective(labels))
        gaps.append(RoleGap(group, len(common), float(multi[0]), float(single[0]), gap))
    return tuple(gaps)


def _compute_harmonic_means(table: ResultTable, names: Sequence[str], counts: Counts) -> Float:
    """Return H (R,) of an agent where episode j counts `counts[r, j]` times; 0 where DS and SR are 0."""
    results = list_results(table, names)
    ds, sr = (
        sum_resamples(counts, np.array([getattr(result, score) for result in results])) / counts.sum(axis=1)
        for score in ("ds", "sr")
    )
    return np.divide(2 * ds * sr, ds + sr, out=np.zeros_like(ds), where=ds + sr > 0)
