"""What cooperation gains (RQ1, RQ2): multi-agent against single-agent systems, and pairs of agents with one planner."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.agents.learned.fusion_spec import FUSIONS
from mdrive_sumo.agents.registry import LEARNED_AGENTS
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
RULE_PAIRS: Mapping[tuple[str, str], str] = {
    ("sharing", "single"): "perception sharing",
    ("sharing+negotiation", "sharing"): "negotiation on top of sharing",
    ("sharing+negotiation", "single"): "both",
    ("colmdriver-rule", "single"): "negotiation by rule, without sharing",
    ("colmdriver", "single"): "negotiation by language model, without sharing",
}
LEARNED_PAIRS: Mapping[tuple[str, str], str] = {
    ("codriving", "codriving:alone"): "features on request",
    ("codriving:fast", "codriving:fast-alone"): "features on request, without the cap",
    ("perception-swap:late", "perception-swap:none"): "boxes of the same detector",
    ("perception-swap:early", "perception-swap:none"): "points, for a detector of its own",
    **{(f"perception-swap:{name}", "perception-swap:none"): "features, for a detector of its own" for name in FUSIONS},
}
PAIRS = {**RULE_PAIRS, **LEARNED_PAIRS}
"""Pairs of agents that differ in this and drive with the same planner, so that their difference is its gain."""
ROLE_GAP = "Multi-agent minus single-agent systems"
SPLIT_AGENTS = ("codriving", "codriving:alone")
"""What splits the gap of learned systems: a sharing system, and the same one without messages."""


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
    """Mean H of multi-agent systems, that of the systems that they are compared with, and the difference [points]."""

    part: str
    """Which systems are compared, in words."""
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


def compute_pair_gains(
    runs: Mapping[str, Results], pairs: Iterable[tuple[str, str]] = tuple(RULE_PAIRS)
) -> tuple[PairGain, ...]:
    """Return the gains of pairs whose agents are both there, by bucket, level and over all scenarios."""
    gains: list[PairGain] = []
    for agent, base in pairs:
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
    """Return the gap of multi-agent and single-agent systems by bucket and level (paper, RQ1); none without both."""
    multi, single = (select_by_role(runs, role) for role in (AgentRole.MULTI, AgentRole.SINGLE))
    return _compute_gaps(runs, {ROLE_GAP: (tuple(multi), tuple(single))})


def split_learned_gap(runs: Mapping[str, Results]) -> tuple[RoleGap, ...]:
    """Return the gap of learned systems by bucket and level, and its two parts, which add up to it.

    The paper's groups differ in messages, planner, sensors and training at once. A system without its messages stands
    between them: the first part is what messages gain, the second all the rest. None unless all three kinds are there.
    """
    sharing, alone = SPLIT_AGENTS
    networks = tuple(name for name in LEARNED_AGENTS if name in runs)
    if not networks or not {*SPLIT_AGENTS} <= {*runs}:
        return ()
    others = ", ".join(networks)
    return _compute_gaps(
        runs,
        {
            f"learned systems: {sharing} minus {others}": ((sharing,), networks),
            f"of it messages: {sharing} minus {alone}": ((sharing,), (alone,)),
            f"of it sensors, planner and training: {alone} minus {others}": ((alone,), networks),
        },
    )


def _compute_gaps(
    runs: Mapping[str, Results], parts: Mapping[str, tuple[Sequence[str], Sequence[str]]]
) -> tuple[RoleGap, ...]:
    """Return gaps of two groups of agents each, over the scenarios that the agents of all parts have.

    H of an agent is the harmonic mean of its mean DS and SR over a group, as in the paper's category figure. The gap
    is the difference of the means of H over the agents of each group. Intervals are over scenarios, not over agents.
    """
    if not all(agents for pair in parts.values() for agents in pair):
        return ()
    compared = {name for pair in parts.values() for agents in pair for name in agents}
    tables = {name: group_by_scenario(run.scenarios) for name, run in runs.items() if name in compared}
    first = next(iter(tables))
    gaps: dict[str, list[RoleGap]] = {part: [] for part in parts}
    for group, names in split_groups(runs[first].scenarios).items():
        common = sorted(name for name in names if all(name in table for table in tables.values()))
        if not common:
            continue
        labels = [result.label for result in list_results(tables[first], common)]
        counts = draw_nested_counts(labels)
        harmonic = {name: _compute_harmonic_means(table, common, counts) for name, table in tables.items()}
        places = len({label[0] for label in labels})
        for part, pair in parts.items():
            multi, single = (np.mean([harmonic[name] for name in agents], axis=0) for agents in pair)
            gap = make_interval(float(multi[0] - single[0]), (multi - single)[1:], places, count_effective(labels))
            gaps[part].append(RoleGap(part, group, len(common), float(multi[0]), float(single[0]), gap))
    return tuple(gap for found in gaps.values() for gap in found)


def _compute_harmonic_means(table: ResultTable, names: Sequence[str], counts: Counts) -> Float:
    """Return H (R,) of an agent where episode j counts `counts[r, j]` times; 0 where DS and SR are 0."""
    results = list_results(table, names)
    ds, sr = (
        sum_resamples(counts, np.array([getattr(result, score) for result in results])) / counts.sum(axis=1)
        for score in ("ds", "sr")
    )
    return np.divide(2 * ds * sr, ds + sr, out=np.zeros_like(ds), where=ds + sr > 0)
