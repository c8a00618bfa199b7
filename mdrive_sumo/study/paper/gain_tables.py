"""Tables of what cooperation gains (RQ1, RQ2)."""

from collections.abc import Sequence

from mdrive_sumo.core.statistics import TOO_FEW_NOTE, judge_interval
from mdrive_sumo.core.tables import (
    Cell,
    Column,
    IntervalStyle,
    Table,
    make_row,
    make_text_columns,
)
from mdrive_sumo.report.published_results import PUBLISHED_GAPS
from mdrive_sumo.study.paper.cooperation_gain import PAIRS, PairGain, RoleGap

SHOWN_NOTE = (
    "Brackets: 95 % bootstrap intervals over scenarios. The last column says what the interval carries: an interval"
    f" that contains 0 shows no difference, neither a gain nor that there is none. {TOO_FEW_NOTE}"
)


def build_pair_table(gains: Sequence[PairGain]) -> Table:
    """Return the paired gains of pairs of agents with one planner, a section for each pair."""
    columns = (
        Column("group", "scenarios"),
        Column("scenarios", "number", decimals=0),
        Column("ds", "DS", "gain", has_sign=True, intervals=IntervalStyle.ENDS),
        Column("sr", "SR", "gain", has_sign=True, intervals=IntervalStyle.ENDS),
        *make_text_columns({"shown_ds": "shown by DS", "shown_sr": "shown by SR"}),
    )
    rows = [
        make_row(
            (
                one.group,
                float(one.scenarios),
                Cell(one.ds.mean, one.ds),
                Cell(one.sr.mean, one.sr),
                judge_interval(one.ds),
                judge_interval(one.sr),
            ),
            f"{PAIRS[one.agent, one.base]}: {one.agent} - {one.base}",
        )
        for one in gains
    ]
    return Table("gains", "What sharing and negotiation gain", columns, tuple(rows), SHOWN_NOTE)


def build_gap_table(gaps: Sequence[RoleGap]) -> Table:
    """Return the gap of multi-agent and single-agent systems by bucket and level, beside the paper's."""
    columns = (
        Column("group", "scenarios"),
        Column("scenarios", "number", decimals=0),
        Column("multi", "multi-agent", "mean H"),
        Column("single", "single-agent", "mean H"),
        Column("gap", "gap", has_sign=True, intervals=IntervalStyle.ENDS),
        *make_text_columns({"shown": "shown"}),
        Column("paper", "gap in the paper (CARLA)", has_sign=True),
    )
    rows = [
        make_row(
            (
                one.group,
                float(one.scenarios),
                one.multi,
                one.single,
                Cell(one.gap.mean, one.gap),
                judge_interval(one.gap),
                PUBLISHED_GAPS.get(one.group),
            )
        )
        for one in gaps
    ]
    note = f"H: harmonic mean of DS and SR of an agent; the mean is over the agents of a kind. {SHOWN_NOTE}"
    return Table("gap", "Multi-agent minus single-agent systems", columns, tuple(rows), note)
