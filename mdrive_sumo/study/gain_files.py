"""The study of the gain as files: `gain.json` with all numbers, `gain.csv` for tables, `gain.md` to read."""

from collections.abc import Sequence
from dataclasses import asdict

from mdrive_sumo.core.statistics import METHOD_NOTE, TOO_FEW_NOTE, Verdict
from mdrive_sumo.core.tables import (
    Table,
    format_csv,
    format_markdown,
    join_paragraphs,
    make_row,
    make_text_columns,
    make_text_table,
)
from mdrive_sumo.scenario.season import read_stored_name
from mdrive_sumo.study.gain import METRICS, PARTS, GainRow, GainSummary
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
    run_to_dict,
)

FORMAT = "mdrive-sumo/gain/1"
HOW_TO_READ = f"""\
Numbers are points of DS and SR (percent), means over scenarios and seeds of paired differences. {METHOD_NOTE}
An interval that contains 0 shows no difference, neither a gain nor that there is none. What is shown is corrected for
the number of rows of the table (Holm 1979), for DS and SR apart. {TOO_FEW_NOTE}"""


def gain_json(about: StudyDescription, rows: Sequence[GainRow], summary: GainSummary) -> str:
    """Return all numbers as JSON."""
    shown = judge_gains(summary)
    page = describe_study(FORMAT, about, rows[0].results[0].run) | {
        "void": summary.void,
        "scores": [
            {"group": line.group, "scenarios": line.scenarios, "sensing": line.sensing, "agent": line.agent}
            | {metric: asdict(line.score[metric]) for metric in METRICS}
            for line in summary.scores
        ],
        "gains": [
            {"group": line.group, "scenarios": line.scenarios, "part": line.part.name}
            | {metric: asdict(line.gain[metric]) | {"shown": shown[metric][i]} for metric in METRICS}
            for i, line in enumerate(summary.gains)
        ],
        "rows": [
            {"sensing": row.sensing, "agent": row.agent, "runs": [run_to_dict(line) for line in row.results]}
            for row in rows
        ],
    }
    return dump_page(page)


def gain_csv(summary: GainSummary) -> str:
    """Return one line for each group, part and metric."""
    shown = judge_gains(summary)
    rows = (
        (line.group, str(line.scenarios), line.part.name, metric, *format_csv_interval(line.gain[metric]), verdicts[i])
        for i, line in enumerate(summary.gains)
        for metric, verdicts in shown.items()
    )
    return format_csv(make_text_table(("group", "scenarios", "part", "metric", "mean", "low", "high", "shown"), rows))


def gain_markdown(about: StudyDescription, rows: Sequence[GainRow], summary: GainSummary) -> str:
    """Return the study as a page."""
    parts = (
        f"# {read_stored_name(about.suite)}: what sharing gains, and by what",
        list_study_facts(about, rows[0].results[0].run, summary.void),
        HOW_TO_READ,
        "\n".join(f"- **{part.name}**: {part.meaning}" for part in PARTS),
        format_markdown(build_gain_table(summary)),
        count_by_chance(line.gain for line in summary.gains),
        "The scores behind it:",
        format_markdown(build_score_table(summary)),
    )
    return join_paragraphs(parts)


def judge_gains(summary: GainSummary) -> dict[str, tuple[Verdict, ...]]:
    """Return what the gains show by metric, in the order of the lines, corrected for their number."""
    return judge_by_metric([line.gain for line in summary.gains])


def build_gain_table(summary: GainSummary) -> Table:
    """Return a row for each group and part."""
    shown = judge_gains(summary)
    columns = (
        *make_text_columns({"scenarios": "scenarios", "part": "part"}),
        *(make_interval_column(metric, metric.upper(), has_sign=True) for metric in METRICS),
        *make_text_columns({"shown_ds": "shown by DS", "shown_sr": "shown by SR"}),
    )
    rows = [
        make_row(
            (
                f"{line.group} ({line.scenarios})",
                line.part.name,
                *(make_interval_cell(line.gain[metric]) for metric in METRICS),
                *(shown[metric][i] for metric in METRICS),
            )
        )
        for i, line in enumerate(summary.gains)
    ]
    return Table("gain", "What sharing gains", columns, tuple(rows))


def build_score_table(summary: GainSummary) -> Table:
    """Return a row for each group and cell."""
    columns = (
        *make_text_columns({"scenarios": "scenarios", "sensing": "sensing", "agent": "agent"}),
        *(make_interval_column(metric, metric.upper()) for metric in METRICS),
    )
    rows = [
        make_row(
            (
                f"{line.group} ({line.scenarios})",
                line.sensing,
                line.agent,
                *(make_interval_cell(line.score[metric]) for metric in METRICS),
            )
        )
        for line in summary.scores
    ]
    return Table("scores", "The scores behind it", columns, tuple(rows))
