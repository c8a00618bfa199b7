"""`report.md`: the results of a run as a Markdown page, and its comparison with what the results give."""

import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import zip_longest
from pathlib import Path

from mdrive_sumo.core.clean_text import clean_for_markdown, format_markdown_code, truncate
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.statistics import METHOD_NOTE, TOO_FEW_NOTE
from mdrive_sumo.core.tables import (
    Cell,
    Column,
    Table,
    format_markdown,
    join_paragraphs,
    make_row,
    make_text_columns,
)
from mdrive_sumo.core.tree_difference import ABSENT
from mdrive_sumo.report.result_tables import (
    CAPTURED_COLUMN,
    SCENARIOS_COLUMN,
    SCORE_COLUMNS,
    TIMED_COLUMN,
    build_interval_table,
    build_rate_table,
    build_role_table,
    build_score_table,
    count_collisions_by_severity,
    count_infractions,
    count_notes,
    count_outcomes,
    describe_agent,
    describe_busy_ratio,
    describe_missing_reference,
    list_percent,
    list_scores,
    name_episode,
)
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.scoring import (
    Results,
    ScenarioResult,
    ScoreMode,
    compute_category_group_means,
    compute_category_means,
    compute_harmonic_mean,
)
from mdrive_sumo.scoring.captured_cooperation import CapturedCooperation
from mdrive_sumo.scoring.metrics import ScalarMetric, list_scalar_metrics

REPORT_FILE = "report.md"
HOW_TO_READ = """\
DS, SR, efficient SR and RC are percentages, IP and the time ratio are factors. The driving score of a CAV is
DS = RC x IP, it succeeds with DS > 99.95. The time ratio is the time that a CAV needs divided by that of
`omniscient`; it is a mean over the scenarios in which every CAV arrives (column "timed"). Efficient SR counts the
successes whose time ratio is at most 2. In score mode `mdrive` a scenario counts the mean over its CAVs; a bucket is
the mean over its scenarios. The bucket mean weighs every bucket alike, the scenario mean every scenario. Void
scenarios (our failure or the simulator's, never the agent's) count as DS 0 and are listed apart. H is the harmonic
mean of DS and SR. IC, LM and LC are InterDrive's groups: intersection crossing, lane merge, lane change;
static-avoidance, dynamic-avoidance and dynamic-coordination are the interactivity levels of Interaction."""

BESIDE = """\
No score depends on these: means over the scenarios in which each is defined. Minimum PET: least time from when a CAV
or another road user leaves a place until the other takes it, at most 5 s. Comfort: share of the CAVs' time in which
accelerations, jerks and yaw rate are within nuPlan's bounds. Messages: payload that all stations send in a second."""
SENT = """\
What all stations together send in a second, by type, over the time of all episodes: messages, and their payload in
bytes. A message to many counts once."""
INTERVALS = f"""\
Means over seeds. {METHOD_NOTE}
{TOO_FEW_NOTE}"""
ROLES = """\
Scores by agent: means over scenarios of means over the CAVs that the agent drives, whatever the score mode."""
MEANS = ("bucket mean", "scenario mean")
CAPTURED = """\
Captured cooperation is (agent - the same agent with the channel off) / (omniscient - the same agent with the
channel off), on mean DS: 0 is driving alone, 100 perfect cooperation. Blank where perfect cooperation gains
less than 2 DS; scenarios that are void in one of the three runs are left out of it."""
FIGURE_MARKS = ("|", "- ", "#", "No ")
"""What a line with figures or facts begins with; others are prose, which changes from version to version."""
MAX_CHARACTERS = 160
"""Of a line in a message; longer ones are cut."""


def build_run_report(results: Results, captured: CapturedCooperation | None = None) -> str:
    """Return the report: run, scores overall, per category and per scenario, and the commands for a closer look."""
    parts = (
        f"# {clean_for_markdown(results.run.suite_label)}: {clean_for_markdown(describe_agent(results))}",
        _facts(results),
        HOW_TO_READ,
        CAPTURED if captured else "",
        _reference_note(results),
        "## Scores",
        _format_means(build_score_table(results, captured)),
        _format_noted(build_interval_table(results), INTERVALS),
        _format_noted(build_role_table(results), ROLES),
        *(("## Beside the score", BESIDE, _format_means(_scalar_table(results))) if results.overall.scalars else ()),
        *_list_traffic(results),
        "## How it ended",
        _counts("outcome", "CAVs", count_outcomes(results)),
        _counts("infraction", "times", count_infractions(results)),
        _counts("impact speed", "collisions", count_collisions_by_severity(results), "No collisions."),
        *((_counts("note", "times", count_notes(results)),) if count_notes(results) else ()),
        _void_list(results),
        "## Categories",
        format_markdown(_category_table(results, captured)),
        "## Scenarios",
        format_markdown(_scenario_table(results)),
        "## Look closer",
        _commands(),
    )
    return join_paragraphs(parts)


def _list_traffic(results: Results) -> list[str]:
    """Return the section of messages: their rates where they vary, and the load of a radio."""
    rates, busy = build_rate_table(results), describe_busy_ratio(results)
    parts = [SENT, format_markdown(rates)] if rates.rows else []
    parts += [f"- channel busy ratio at the CAVs: {busy}"] if busy else []
    return ["## Messages", *parts] if parts else []


def save_run_report(folder: Path, results: Results, captured: CapturedCooperation | None = None) -> None:
    """Write `report.md` into a run folder. Raises InputError if that is not possible."""
    path = folder / REPORT_FILE
    with report_write_errors(path):
        write_text(path, build_run_report(results, captured))


def _facts(results: Results) -> str:
    run = results.run
    facts = {
        "suite": f"{clean_for_markdown(run.suite_label)}, checksum {format_markdown_code(run.suite_checksum)}",
        "seeds" if len(run.all_seeds) > 1 else "seed": ", ".join(map(str, run.all_seeds)),
        "score mode": clean_for_markdown(run.score_mode),
        **{name: clean_for_markdown(str(value)) for name, value in run.shown_conditions.items()},
        "command": format_markdown_code(shlex.join(run.command)),
        "versions": clean_for_markdown(
            ", ".join(f"{name} {version}" for name, version in sorted(run.versions.items()))
        ),
    }
    return "\n".join(f"- {name}: {value}" for name, value in facts.items())


def _reference_note(results: Results) -> str:
    missing = describe_missing_reference(results)
    text = "Reference times, without which time ratio and efficient SR are undefined (-):"
    return f"{text} {missing}." if missing else ""


def _format_means(table: Table) -> str:
    """Return a table whose overall means are bold."""
    rows = [
        replace(row, cells=(Cell(f"**{row.cells[0].value}**"), *row.cells[1:])) if row.cells[0].value in MEANS else row
        for row in table.rows
    ]
    return format_markdown(replace(table, rows=tuple(rows)))


def _scalar_table(results: Results) -> Table:
    metrics = [metric for metric in list_scalar_metrics() if metric.name in results.overall.scalars]
    means = {name: bucket.scalars for name, bucket in results.buckets.items()} | {MEANS[1]: results.overall.scalars}
    columns = (Column("bucket", "bucket"), *_make_scalar_columns(metrics))
    rows = [make_row((name, *(scalars.get(metric.name) for metric in metrics))) for name, scalars in means.items()]
    return Table("scalars", "Beside the score", columns, tuple(rows))


def _make_scalar_columns(metrics: Iterable[ScalarMetric]) -> list[Column]:
    return [Column(metric.name, metric.label, decimals=metric.decimals) for metric in metrics]


def _format_noted(table: Table, note: str) -> str:
    """Return a table below its note; "" without rows."""
    return f"{note}\n\n{format_markdown(table)}" if table.rows else ""


def _counts(name: str, unit: str, counts: Mapping[str, int], empty: str = "") -> str:
    rows = tuple(make_row((kind, count)) for kind, count in counts.items())
    columns = Column(name, name), Column(unit, unit, decimals=0)
    return format_markdown(Table(name, name, columns, rows)) if rows else empty or f"No {name}s."


def _void_list(results: Results) -> str:
    return "\n".join(
        f"- void: {clean_for_markdown(name_episode(results.run, s))}: {clean_for_markdown(s.reason)}"
        for s in results.scenarios
        if s.status == "void"
    )


def _category_table(results: Results, captured: CapturedCooperation | None) -> Table:
    means = compute_category_means(results.scenarios)
    means |= compute_category_group_means(results.scenarios, ScoreMode(results.run.score_mode))
    columns = (Column("category", "category"), SCENARIOS_COLUMN, *SCORE_COLUMNS, TIMED_COLUMN, Column("h", "H"))
    rows = [
        (name, group.scenarios, *list_scores(group), group.timed, compute_harmonic_mean(group))
        for name, group in means.items()
    ]
    if captured is not None:
        columns = (*columns, CAPTURED_COLUMN)
        shares = list_percent(captured.categories.get(name) for name in means)
        rows = [(*row, share) for row, share in zip(rows, shares, strict=True)]
    return Table("categories", "Categories", columns, tuple(map(make_row, rows)))


def _scenario_table(results: Results) -> Table:
    metrics = list_scalar_metrics()
    columns = (
        *make_text_columns({"scenario": "scenario", "category": "category"}),
        *SCORE_COLUMNS,
        *_make_scalar_columns(metrics),
        Column("ticks", "ticks", decimals=0),
        Column("cavs", "CAVs"),
    )
    rows = [
        make_row(
            (
                name_episode(results.run, scenario),
                scenario.category,
                *list_scores(scenario),
                *(scenario.find_scalar(metric.name) for metric in metrics),
                scenario.ticks,
                _endings(scenario),
            )
        )
        for scenario in results.scenarios
    ]
    return Table("scenarios", "Scenarios", columns, tuple(rows), left=2)


def _endings(scenario: ScenarioResult) -> str:
    if scenario.status == "void":
        return "void"
    return ", ".join(f"{ego.id} {ego.outcome}" for ego in scenario.egos)


def _commands() -> str:
    return "\n".join(
        (
            "    mdrive-sumo view RUN                   see in the browser what each CAV lost, and why",
            "    mdrive-sumo view RUN --scenario ID     watch an episode in the browser",
            "    mdrive-sumo verify RUN                 execute it again and compare every tick",
            "    mdrive-sumo rescore RUN                score the recordings again, without simulation",
            "    mdrive-sumo compare RUN OTHER_RUN      two runs side by side",
        )
    )


def has_captured_cooperation(text: str) -> bool:
    """Return whether a report has the columns of `--captured`, which depend on other runs."""
    return CAPTURED_COLUMN.label in text


def find_report_differences(expected: Results, text: str) -> Iterator[str]:
    """Yield a sentence for every line with figures that is not as the results give it.

    Columns of captured cooperation are left out: see `has_captured_cooperation`.
    """
    right = _list_figures(build_run_report(expected))
    for (_, line), (number, read) in zip_longest(right, _list_figures(text), fillvalue=(0, ABSENT)):
        if line != read:
            place = f"line {number}" if number else "end"
            yield f"{place}: expected {truncate(line, MAX_CHARACTERS)}, found {truncate(read, MAX_CHARACTERS)}"


def _list_figures(text: str) -> Sequence[tuple[int, str]]:
    """Return number and content of the lines with figures."""
    lines: list[tuple[int, str]] = []
    is_captured = False
    for number, line in enumerate(text.splitlines(), start=1):
        is_captured = CAPTURED_COLUMN.label in line or (is_captured and line.startswith("|"))
        if line.startswith(FIGURE_MARKS):
            lines.append((number, line.rsplit("|", 2)[0].rstrip() + " |" if is_captured else line))
    return lines
