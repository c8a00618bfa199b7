"""Tables that only the study has: scenarios driven, gains of cooperation (RQ1, RQ2), worse channels (RQ5)."""

from collections.abc import Mapping, Sequence

from mdrive_sumo.core.statistics import METHOD_NOTE, TOO_FEW_NOTE, describe_comparisons, judge_intervals
from mdrive_sumo.core.tables import (
    Cell,
    CellValue,
    Column,
    IntervalStyle,
    Row,
    Table,
    make_row,
    make_text_columns,
)
from mdrive_sumo.report.published_results import AS_PUBLISHED, PUBLISHED_GAPS, PublishedDegradation
from mdrive_sumo.scenario.categories import FIGURES, Category
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.statistics import PAPER, compute_suite_statistics
from mdrive_sumo.scoring.paired_intervals import (
    compute_difference_interval,
    compute_score_interval,
    group_by_scenario,
)
from mdrive_sumo.study.conditions import ChannelCondition
from mdrive_sumo.study.paper.cooperation_gain import PAIRS, ROLE_GAP, PairGain, RoleGap
from mdrive_sumo.study.study_runs import StudyRow

COLUMNS = {
    "scenarios": ("scenarios", 0),
    "cavs": ("CAVs", 2),
    "route_m": ("route [m]", 2),
    "heading_change_deg": ("heading change [deg]", 2),
    "actors": ("actors", 2),
}
BUCKETS, CATEGORIES = "bucket", "category of Interaction"
SHOWN_NOTE = (
    f"{METHOD_NOTE} The last column says what the interval carries, corrected for the number of differences of each"
    " score (Holm 1979): an interval that contains 0 shows no difference, neither a gain nor that there is none."
    f" {TOO_FEW_NOTE}"
)
SCORES: Mapping[str, tuple[str, int]] = {"ds": ("DS", 2), "rc": ("RC", 2), "ip": ("IS", 3), "sr": ("SR", 2)}
"""Scores of the paper's tables with their decimals; its IS is the infraction penalty IP."""
INTERVALS = ("ds", "sr")
"""Scores whose differences are shown with an interval: the table shall fit a page."""


def build_scenario_table(scenarios: Sequence[Scenario]) -> Table:
    """Return statistics by bucket and by Interaction's category, with the paper's numbers beside them."""
    columns = [Column("group", "")]
    for source in ("driven", "paper"):
        columns += [Column(f"{key}_{source}", *_label(key, source)) for key in COLUMNS]
    rows = [
        _make_row(
            bucket,
            [scenario for scenario in scenarios if scenario.bucket == bucket],
            _find_paper_bucket(bucket),
            BUCKETS,
        )
        for bucket in dict.fromkeys(scenario.bucket for scenario in scenarios)
    ]
    for category in Category:
        if members := [scenario for scenario in scenarios if scenario.category == category]:
            figures = FIGURES.get(category)
            paper = (float(figures.count), *figures.means) if figures else (None,) * len(COLUMNS)
            rows.append(_make_row(category, members, paper, CATEGORIES))
    note = "Means over scenarios, of routes and heading changes over CAVs. Actors: road users and props besides CAVs."
    return Table("scenarios", "Scenarios driven, and those of the paper", tuple(columns), tuple(rows), note)


def _label(key: str, source: str) -> tuple[str, str, int]:
    label, decimals = COLUMNS[key]
    return label, source, decimals


def _find_paper_bucket(bucket: str) -> tuple[float | None, ...]:
    figures = PAPER.get(bucket.lower())
    if figures is None:
        return (None,) * len(COLUMNS)
    means = (figures.mean_cavs, figures.mean_route_m, figures.mean_heading_change_deg, figures.mean_actors)
    return (float(figures.scenarios), *means)


def _make_row(name: str, scenarios: Sequence[Scenario], paper: Sequence[float | None], section: str) -> Row:
    statistics = compute_suite_statistics(scenarios)
    means = (statistics.mean_cavs, statistics.mean_route_m, statistics.mean_heading_change_deg, statistics.mean_actors)
    return make_row((name, float(statistics.scenarios), *means, *paper), section)


def build_pair_table(gains: Sequence[PairGain], name: str = "gains", who: str = "rule") -> Table:
    """Return the paired gains of pairs of agents with one planner, a section for each pair. who: what they drive by."""
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
                gain.group,
                float(gain.scenarios),
                Cell(gain.ds.mean, gain.ds),
                Cell(gain.sr.mean, gain.sr),
                *verdicts,
            ),
            f"{PAIRS[gain.agent, gain.base]}: {gain.agent} - {gain.base}",
        )
        for gain, *verdicts in zip(
            gains, judge_intervals([one.ds for one in gains]), judge_intervals([one.sr for one in gains]), strict=True
        )
    ]
    note = f"{SHOWN_NOTE} {describe_comparisons([one for gain in gains for one in (gain.ds, gain.sr)])}".rstrip()
    return Table(name, f"What messages gain: agents that drive by {who}", columns, tuple(rows), note)


def build_gap_table(gaps: Sequence[RoleGap]) -> Table:
    """Return gaps by bucket and level, a section for each part, the paper's beside what has its counterpart."""
    is_split = gaps[0].part != ROLE_GAP
    columns = (
        Column("group", "scenarios"),
        Column("scenarios", "number", decimals=0),
        Column("multi", "multi-agent", "mean H"),
        Column("single", "compared with", "mean H"),
        Column("gap", "gap", has_sign=True, intervals=IntervalStyle.ENDS),
        *make_text_columns({"shown": "shown"}),
        Column("paper", "gap in the paper (CARLA)", has_sign=True),
    )
    rows = [
        make_row(
            (
                gap.group,
                float(gap.scenarios),
                gap.multi,
                gap.single,
                Cell(gap.gap.mean, gap.gap),
                shown,
                PUBLISHED_GAPS.get(gap.group) if gap.part == gaps[0].part else None,
            ),
            gap.part if is_split else "",
        )
        for gap, shown in zip(gaps, judge_intervals([one.gap for one in gaps]), strict=True)
    ]
    note = f"H: harmonic mean of DS and SR of an agent; the mean is over the agents of a kind. {SHOWN_NOTE}"
    name, title = ("gap_learned", "The gap of learned systems, and its parts") if is_split else ("gap", ROLE_GAP)
    return Table(name, title, columns, tuple(rows), note)


def build_channel_table(
    name: str,
    title: str,
    rows: Sequence[StudyRow],
    conditions: tuple[ChannelCondition, ChannelCondition],
    published: Sequence[PublishedDegradation],
) -> Table:
    """Return the table of one perturbation for every agent that has both rows.

    conditions: the clean one and the perturbed one. Differences are paired by scenario and seed; scenarios that are
    void in one of the two are left out of both.
    """
    clean, perturbed = conditions
    by_key = {(row.agent, row.condition.name): row for row in rows}
    agents = [row.agent for row in rows if row.condition.name == clean.name]
    ours = [
        _build_row(agent, by_key[agent, clean.name], by_key[agent, perturbed.name])
        for agent in agents
        if (agent, perturbed.name) in by_key
    ]
    return Table(
        name, title, _make_columns(), (*ours, *map(_build_published_row, published)), note=_describe(ours, published)
    )


def _make_columns() -> tuple[Column, ...]:
    columns = [Column("agent", "agent")]
    for score, (label, decimals) in SCORES.items():
        columns += [
            Column(f"{score}_clean", "clean", label, decimals),
            Column(f"{score}_perturbed", "perturbed", label, decimals),
            Column(f"{score}_difference", "Δ", label, decimals, has_sign=True, intervals=IntervalStyle.ENDS),
        ]
    return tuple(columns)


def _build_row(agent: str, clean: StudyRow, perturbed: StudyRow) -> Row:
    tables = [group_by_scenario(row.scenarios) for row in (clean, perturbed)]
    common = tables[0].keys() & tables[1].keys()
    first, second = ({name: table[name] for name in table if name in common} for table in tables)
    cells: list[CellValue | Cell] = [agent]
    for score in SCORES:
        means = [compute_score_interval(table, score) for table in (first, second)]
        difference = compute_difference_interval(second, first, score)
        cells += [None if mean is None else mean.mean for mean in means]
        has_interval = score in INTERVALS
        cells.append(Cell(None) if difference is None else Cell(difference.mean, difference if has_interval else None))
    return make_row(cells, "mdrive-sumo")


def _build_published_row(published: PublishedDegradation) -> Row:
    cells: list[CellValue] = [published.method]
    for score in SCORES:
        clean, perturbed = getattr(published, score)
        cells += [clean, perturbed, perturbed - clean]
    return make_row(cells, AS_PUBLISHED, is_ranked=False)


def _describe(ours: Sequence[Row], published: Sequence[PublishedDegradation]) -> str:
    if not ours:
        return "No agent of this study exchanges messages."
    note = (
        f"{METHOD_NOTE} Differences are paired by scenario and seed; an interval that contains 0 shows no"
        f" effect. {TOO_FEW_NOTE}"
    )
    rounded = "Published differences are those of the printed scores; the paper prints some that deviate by 0.01."
    return f"{note} {rounded}" if published else note
