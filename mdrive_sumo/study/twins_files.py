"""The study of twins as files: `twins.json`, `twins.csv`, `twins-episodes.csv` and `twins.md`."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict

from mdrive_sumo.core.statistics import METHOD_NOTE, TOO_FEW_NOTE, Verdict
from mdrive_sumo.core.tables import (
    Column,
    Table,
    format_csv,
    format_markdown,
    join_paragraphs,
    make_row,
    make_text_columns,
    make_text_table,
)
from mdrive_sumo.scenario.season import read_stored_name
from mdrive_sumo.study.study_files import (
    StudyDescription,
    count_by_chance,
    describe_study,
    dump_page,
    format_csv_interval,
    judge_by_metric,
    list_study_facts,
    make_interval_cell,
    make_interval_column,
)
from mdrive_sumo.study.twin_scenarios import TwinFactor
from mdrive_sumo.study.twins import METRICS, TwinRow, TwinSummary

FORMAT = "mdrive-sumo/twins/1"
MEANING = {
    TwinFactor.OCCLUDER: "buildings, props and standing vehicles that hide the road users of certified or occluded"
    " conflicts are gone",
    TwinFactor.CONNECTION: "no station sends: neither CAVs nor road-side units",
    TwinFactor.BACKGROUND: "the traffic of SUMO is gone, but for occluders and road users of certified or occluded"
    " conflicts",
    TwinFactor.WEATHER: "a clear day instead of rain or night",
    TwinFactor.STRANGER: "one CAV, drawn by the seed, is driven by another agent; scores are those of the other CAVs",
}
HOW_TO_READ = f"""\
A twin is a scenario in which exactly one factor is changed. DS and SR [%] are means over the scenarios that have this
twin and are void in neither. A change is twin - original, paired by scenario and seed. An interval without 0 shows an
effect: above 0 (gain) the agent does better in the twin, below 0 (loss) worse. {METHOD_NOTE} What is shown is corrected
for the number of rows of the table (Holm 1979), for DS and SR apart. Reference times and time limits are those of the
original. {TOO_FEW_NOTE}"""


def twins_json(about: StudyDescription, stranger: str, rows: Sequence[TwinRow], summary: TwinSummary) -> str:
    """Return all numbers as JSON."""
    first, shown = rows[0].agent, judge_changes(summary)
    page = describe_study(FORMAT, about, rows[0].results[0].run) | {
        "stranger": stranger,
        "void": summary.void,
        "lines": [
            {"agent": line.agent, "factor": line.factor, "scenarios": line.scenarios}
            | {name: {m: asdict(getattr(line, name)[m]) for m in METRICS} for name in ("original", "twin")}
            | {"change": {metric: asdict(line.change[metric]) | {"shown": shown[metric][i]} for metric in METRICS}}
            for i, line in enumerate(summary.lines)
        ],
        "twins": [
            {"scenario": twin.scenario.id, "factor": twin.factor, "changes": list(twin.changes)}
            for row in rows
            if row.agent == first
            for twin in row.twins
        ],
        "not_made": [asdict(gap) for gap in summary.gaps],
    }
    return dump_page(page)


def twins_csv(summary: TwinSummary) -> str:
    """Return one line for each agent, factor and metric."""
    shown = judge_changes(summary)
    rows = (
        (line.agent, line.factor, str(line.scenarios), metric, *format_csv_interval(line.change[metric]), verdicts[i])
        for i, line in enumerate(summary.lines)
        for metric, verdicts in shown.items()
    )
    return format_csv(make_text_table(("agent", "factor", "scenarios", "metric", "mean", "low", "high", "shown"), rows))


def twin_episodes_csv(summary: TwinSummary) -> str:
    """Return one line for each agent, factor, scenario and seed: all values that the table is made from."""
    rows = (
        (
            line.agent,
            line.factor,
            base.place,
            base.id,
            str(base.seed),
            *(f"{getattr(one, metric):.6f}" for metric in METRICS for one in (base, twin)),
        )
        for line in summary.lines
        for base, twin in line.pairs
    )
    names = ("agent", "factor", "place", "scenario", "seed", "ds", "twin_ds", "sr", "twin_sr")
    return format_csv(make_text_table(names, rows))


def twins_markdown(
    about: StudyDescription, stranger: str, rows: Sequence[TwinRow], summary: TwinSummary, picture: str
) -> str:
    """Return the study as a page."""
    factors = dict.fromkeys(row.factor for row in rows if row.factor is not None)
    parts = (
        f"# {read_stored_name(about.suite)}: what each factor costs",
        list_study_facts(about, rows[0].results[0].run, summary.void),
        HOW_TO_READ,
        "\n".join(f"- **{factor}**: {describe_factor(factor, stranger)}" for factor in factors),
        format_markdown(build_twins_table(summary)),
        count_by_chance(line.change for line in summary.lines),
        f"![what each factor costs]({picture})",
        *(("Twins that cannot be made:", format_markdown(build_gap_table(summary))) if summary.gaps else ()),
        "\n".join(f"- {gap.reason}" for gap in summary.gaps),
    )
    return join_paragraphs(parts)


def describe_factor(factor: TwinFactor, stranger: str) -> str:
    """Return what the twins of a factor change."""
    return MEANING[factor].replace("another agent", f"`{stranger}`")


def judge_changes(summary: TwinSummary) -> dict[str, tuple[Verdict, ...]]:
    """Return what the changes show by metric, in the order of the lines, corrected for their number."""
    return judge_by_metric([line.change for line in summary.lines])


def build_twins_table(summary: TwinSummary) -> Table:
    """Return a row for each agent and factor."""
    shown = judge_changes(summary)
    columns = (
        *make_text_columns({"agent": "agent", "factor": "factor"}),
        Column("scenarios", "scenarios", decimals=0),
        *(Column(f"{name}_ds", label, decimals=1) for name, label in (("original", "DS"), ("twin", "DS of the twin"))),
        *(make_interval_column(f"{metric}_change", f"{metric.upper()} change", has_sign=True) for metric in METRICS),
        *make_text_columns({"shown_ds": "shown by DS", "shown_sr": "shown by SR"}),
    )
    rows = [
        make_row(
            (
                line.agent,
                line.factor,
                line.scenarios,
                line.original["ds"].mean,
                line.twin["ds"].mean,
                *(make_interval_cell(line.change[metric]) for metric in METRICS),
                *(shown[metric][i] for metric in METRICS),
            )
        )
        for i, line in enumerate(summary.lines)
    ]
    return Table("twins", "What each factor costs", columns, tuple(rows), left=2)


def build_gap_table(summary: TwinSummary) -> Table:
    """Return how many twins of each factor cannot be made, by reason; without rows if all can be."""
    reasons = Counter((gap.factor, gap.reason.partition(": expected ")[2]) for gap in summary.gaps)
    columns = (
        *make_text_columns({"factor": "factor not changed", "reason": "because expected"}),
        Column("scenarios", "scenarios", decimals=0),
    )
    rows = [make_row((factor, reason, count)) for (factor, reason), count in sorted(reasons.items())]
    return Table("gaps", "Twins that cannot be made", columns, tuple(rows), left=2)
