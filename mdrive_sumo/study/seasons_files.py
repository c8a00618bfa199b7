"""The study of seasons as files: `seasons.json` with all numbers, `seasons.csv` for tables, `seasons.md` to read."""

from collections.abc import Sequence
from dataclasses import asdict

from mdrive_sumo.core.statistics import METHOD_NOTE, TOO_FEW_NOTE, describe_comparisons
from mdrive_sumo.core.tables import Column, Table, format_csv, format_markdown, make_row, make_text_columns
from mdrive_sumo.scenario.season import label_suite, split_suite_name
from mdrive_sumo.study.seasons import OLD, SeasonRow, SeasonSummary
from mdrive_sumo.study.study_files import (
    StudyDescription,
    describe_study,
    dump_page,
    format_facts,
    make_interval_cell,
    make_interval_column,
    run_to_dict,
)

FORMAT = "mdrive-sumo/seasons/1"
HOW_TO_READ = f"""\
Means over scenarios and seeds of each season, in percent. "All" is the mean over the seasons, "fresh - {OLD}" what is
left of it in the seasons after season {OLD}: less than 0 is lost. {METHOD_NOTE} Seasons are not drawn anew: the
intervals are about other places of these seasons. {TOO_FEW_NOTE}"""


def seasons_json(about: StudyDescription, rows: Sequence[SeasonRow], summary: SeasonSummary) -> str:
    """Return all numbers as JSON."""
    page = describe_study(FORMAT, about, rows[0].results[0].run) | {
        "suite": split_suite_name(about.suite)[0],
        "seasons": {row.season: row.results[0].run.suite_checksum for row in rows},
        "void": summary.void,
        "lines": {metric: [asdict(line) for line in lines] for metric, lines in summary.lines.items()},
        "rows": [
            {"agent": row.agent, "season": row.season, "runs": [run_to_dict(one) for one in row.results]}
            for row in rows
        ],
    }
    del page["suite_checksum"]
    return dump_page(page)


def seasons_csv(summary: SeasonSummary) -> str:
    """Return both tables as one, with a column for the metric."""
    tables = {metric: build_seasons_table(summary, metric) for metric in summary.lines}
    columns = next(iter(tables.values())).columns
    rows = [
        make_row((metric, *row.cells)) for metric, table in tables.items() for row in table.rows
    ]  # one row for each metric and agent
    return format_csv(Table("seasons", "Seasons", (*make_text_columns({"metric": "metric"}), *columns), tuple(rows)))


def seasons_markdown(about: StudyDescription, rows: Sequence[SeasonRow], summary: SeasonSummary) -> str:
    """Return the study as a page."""
    suite = split_suite_name(about.suite)[0]
    run = rows[0].results[0].run
    checksums = {row.season: row.results[0].run.suite_checksum for row in rows}
    facts = {
        **{label_suite(suite, season): f"checksum `{checksums[season]}`" for season in summary.seasons},
        "left out as void": str(summary.void),
        "seeds": ", ".join(map(str, rows[0].seeds)),
        "score mode": run.score_mode,
        "channel": ", ".join(f"{name} {value}" for name, value in run.comm.items()),
        "command": f"`{' '.join(about.command)}`",
        "versions": ", ".join(f"{name} {version}" for name, version in sorted(run.versions.items())),
    }
    tables = (
        part
        for metric in summary.lines
        for part in (
            f"## {metric.upper()}",
            format_markdown(build_seasons_table(summary, metric)),
            describe_comparisons([line.fresh_loss for line in summary.lines[metric]]),
        )
        if part
    )
    return "\n\n".join((f"# {suite} over seasons", format_facts(facts), HOW_TO_READ, *tables)) + "\n"


def build_seasons_table(summary: SeasonSummary, metric: str) -> Table:
    """Return a row for each agent: its mean in each season and over all, and what it loses from season 0 on."""
    columns = (
        *make_text_columns({"agent": "agent"}),
        *(Column(f"season_{season}", season, group="season", decimals=1) for season in summary.seasons),
        make_interval_column("mean", "all"),
        make_interval_column("fresh_loss", f"fresh - {OLD}", has_sign=True),
    )
    rows = [
        make_row(
            (
                line.agent,
                *(line.by_season[season] for season in summary.seasons),
                make_interval_cell(line.mean),
                make_interval_cell(line.fresh_loss),
            )
        )
        for line in summary.lines[metric]
    ]
    return Table(f"seasons_{metric}", f"{metric.upper()} over seasons", columns, tuple(rows))
