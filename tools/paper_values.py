"""RQ1, RQ3 and RQ5 of `study paper` from values: gaps and gains, both loops, latency and pose error."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import Table, format_markdown
from mdrive_sumo.open_loop import OpenLoopResults
from mdrive_sumo.scoring import Results
from mdrive_sumo.study.conditions import ChannelCondition
from mdrive_sumo.study.paper.cooperation_gain import (
    LEARNED_PAIRS,
    RULE_PAIRS,
    RoleGap,
    compute_pair_gains,
    compute_role_gaps,
    split_learned_gap,
)
from mdrive_sumo.study.paper.open_closed import compare_open_with_closed
from mdrive_sumo.study.paper.open_closed_table import build_correlation_table, build_open_closed_table
from mdrive_sumo.study.paper.paper_study import CONDITIONS, is_surrogate, select_results
from mdrive_sumo.study.paper.paper_tables import build_channel_table, build_gap_table, build_pair_table
from mdrive_sumo.study.study_runs import StudyRow
from tools.published_values import Values

CLOSED = "closed"
"""Part of the runs over the clean channel; the others are named after the folders of their conditions."""
REFERENCE = "reference"
"""Folder of the drives that open loop compares with, if `omniscient` is none of the agents."""
CLEAN = CONDITIONS[0]
PERTURBED: Mapping[str, ChannelCondition] = dict(zip(("latency", "pose-error"), CONDITIONS[1:], strict=True))
"""Conditions of RQ5 by table."""
GAPS: Mapping[str, Callable[[Mapping[str, Results]], Sequence[RoleGap]]] = {
    "gap": compute_role_gaps,
    "gap-learned": split_learned_gap,
}
GAINS = {"gains": RULE_PAIRS, "gains-learned": LEARNED_PAIRS}
TABLES = ("open-closed", *PERTURBED, *GAPS, *GAINS)


def find_paper_part(file: Path) -> str:
    """Return the part of a results file of `study paper` by its folder; "" for another run."""
    names = [folder.name for folder in file.parents][:3]
    if names[-1] == "channel":
        return names[0]
    return CLOSED if names[1:2] == [CLOSED] or names[1:2] == [REFERENCE] else ""


def list_shown_runs(table: str, values: Values) -> Sequence[Results]:
    """Return the runs whose scenarios a table shows: with perturbations fewer scenarios are driven than without."""
    perturbed = values.get(PERTURBED[table].folder) if table in PERTURBED else None
    return perturbed or values[CLOSED]


def list_paper_table(table: str, values: Values, opened: Sequence[OpenLoopResults]) -> Sequence[str]:
    """Return the paragraphs of a table. Raises InputError if its runs are not there."""
    closed = {results.run.agent: results for results in values[CLOSED]}
    if table in PERTURBED:
        return _format_tables([_build_perturbed(table, values, closed)])
    if table in GAPS or table in GAINS:
        return _format_tables([_build_gains(table, {name: closed[name] for name in closed if not is_surrogate(name)})])
    if missing := [one.run.agent for one in opened if one.run.agent not in closed] or ([] if opened else ["open loop"]):
        raise InputError(f"table {table}: expected every agent in both loops, found no runs of {missing[0]}")
    comparison = compare_open_with_closed({one.run.agent: one for one in opened}, closed)
    return _format_tables([build_open_closed_table(comparison), build_correlation_table(comparison)])


def _build_gains(table: str, runs: Mapping[str, Results]) -> Table:
    gaps = GAPS[table](runs) if table in GAPS else ()
    gains = compute_pair_gains(runs, GAINS[table]) if table in GAINS else ()
    if not gaps and not gains:
        raise InputError(f"table {table}: expected agents that it compares, found {', '.join(runs)}")
    return build_gap_table(gaps) if gaps else build_pair_table(gains)


def _build_perturbed(table: str, values: Values, closed: Mapping[str, Results]) -> Table:
    """Return the table of one perturbation, over the scenarios that were driven with it."""
    condition = PERTURBED[table]
    rows: list[StudyRow] = []
    for worse in values.get(condition.folder, ()):
        scenarios = tuple({result.id for result in worse.scenarios})
        clean = select_results(closed[worse.run.agent], scenarios)
        rows.append(StudyRow(worse.run.agent, CLEAN, (clean,), reused=False))
        rows.append(StudyRow(worse.run.agent, condition, (worse,), reused=False))
    return build_channel_table(table, "", rows, (CLEAN, condition), ())


def _format_tables(tables: Sequence[Table]) -> Sequence[str]:
    return [part for table in tables for part in (format_markdown(table), table.note)]
