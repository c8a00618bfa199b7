"""`report.md`: the results of a run as a Markdown page."""

import shlex
from collections.abc import Iterable
from pathlib import Path

from mdrive_sumo.core.clean_text import clean_for_markdown, format_markdown_code
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.statistics import TOO_FEW_NOTE
from mdrive_sumo.core.tables import TableRow, format_markdown_table
from mdrive_sumo.loop import EpisodeOptions
from mdrive_sumo.report.result_tables import (
    CAPTURED_HEADER,
    INTERVAL_HEADER,
    ROLE_HEADER,
    SCORE_HEADER,
    TIMED_HEADER,
    build_interval_rows,
    build_role_rows,
    build_score_rows,
    count_collisions_by_severity,
    count_infractions,
    count_notes,
    count_outcomes,
    describe_agent,
    describe_missing_reference,
    format_captured,
    format_scores,
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
INTERVALS = f"""\
Means over seeds with 95 % bootstrap intervals: scenarios are drawn anew, then seeds within each.
{TOO_FEW_NOTE}"""
ROLES = """\
Scores by agent: means over scenarios of means over the CAVs that the agent drives, whatever the score mode."""
MEANS = ("bucket mean", "scenario mean")
CAPTURED = """\
Captured cooperation is (agent - the same agent with the channel off) / (omniscient - the same agent with the
channel off), on mean DS: 0 is driving alone, 100 perfect cooperation. Blank where perfect cooperation gains
less than 2 DS; scenarios that are void in one of the three runs are left out of it."""


def build_run_report(results: Results, captured: CapturedCooperation | None = None) -> str:
    """Return the report: run, scores overall, per category and per scenario, and the commands for a closer look."""
    parts = (
        f"# {clean_for_markdown(results.run.suite)}: {clean_for_markdown(describe_agent(results))}",
        _facts(results),
        HOW_TO_READ,
        CAPTURED if captured else "",
        _reference_note(results),
        "## Scores",
        _score_table(results, captured),
        _interval_table(results),
        _role_table(results),
        *(("## Beside the score", BESIDE, _scalar_table(results)) if results.overall.scalars else ()),
        "## How it ended",
        _counts("outcome", "CAVs", count_outcomes(results).items()),
        _counts("infraction", "times", count_infractions(results).items()),
        _counts("impact speed", "collisions", count_collisions_by_severity(results).items(), "No collisions."),
        *((_counts("note", "times", count_notes(results).items()),) if count_notes(results) else ()),
        _void_list(results),
        "## Categories",
        _category_table(results, captured),
        "## Scenarios",
        _scenario_table(results),
        "## Look closer",
        _commands(),
    )
    return "\n\n".join(part for part in parts if part) + "\n"


def save_run_report(folder: Path, results: Results, captured: CapturedCooperation | None = None) -> None:
    """Write `report.md` into a run folder. Raises InputError if that is not possible."""
    path = folder / REPORT_FILE
    with report_write_errors(path):
        write_text(path, build_run_report(results, captured))


def _facts(results: Results) -> str:
    run = results.run
    facts = {
        "suite": f"{clean_for_markdown(run.suite)}, checksum {format_markdown_code(run.suite_checksum)}",
        "seeds" if len(run.all_seeds) > 1 else "seed": ", ".join(map(str, run.all_seeds)),
        "score mode": clean_for_markdown(run.score_mode),
        **{key: clean_for_markdown(str(getattr(run, key))) for key in EpisodeOptions.list_choices()},
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


def _score_table(results: Results, captured: CapturedCooperation | None) -> str:
    header, rows = build_score_rows(results, captured)
    return format_markdown_table(header, [(f"**{row[0]}**" if row[0] in MEANS else row[0], *row[1:]) for row in rows])


def _scalar_table(results: Results) -> str:
    metrics = [metric for metric in list_scalar_metrics() if metric.name in results.overall.scalars]
    groups = {name: bucket.scalars for name, bucket in results.buckets.items()}
    groups["**scenario mean**"] = results.overall.scalars
    rows = [(name, *(_format_scalar(found.get(m.name), m) for m in metrics)) for name, found in groups.items()]
    return format_markdown_table(("bucket", *(metric.label for metric in metrics)), rows)


def _interval_table(results: Results) -> str:
    rows = build_interval_rows(results)
    return f"{INTERVALS}\n\n{format_markdown_table(INTERVAL_HEADER, rows)}" if rows else ""


def _role_table(results: Results) -> str:
    rows = build_role_rows(results)
    return f"{ROLES}\n\n{format_markdown_table(ROLE_HEADER, rows)}" if rows else ""


def _counts(name: str, unit: str, counts: Iterable[tuple[str, int]], empty: str = "") -> str:
    rows = [(kind, str(count)) for kind, count in counts]
    return format_markdown_table((name, unit), rows) if rows else empty or f"No {name}s."


def _void_list(results: Results) -> str:
    return "\n".join(
        f"- void: {clean_for_markdown(name_episode(results.run, s))}: {clean_for_markdown(s.reason)}"
        for s in results.scenarios
        if s.status == "void"
    )


def _category_table(results: Results, captured: CapturedCooperation | None) -> str:
    groups = compute_category_group_means(results.scenarios, ScoreMode(results.run.score_mode))
    rows: list[TableRow] = [
        (name, str(group.scenarios), *format_scores(group), str(group.timed), f"{compute_harmonic_mean(group):.2f}")
        for name, group in (compute_category_means(results.scenarios) | groups).items()
    ]
    header: TableRow = ("category", "scenarios", *SCORE_HEADER, TIMED_HEADER, "H")
    if captured is None:
        return format_markdown_table(header, rows)
    shares = captured.categories
    return format_markdown_table(
        (*header, CAPTURED_HEADER), [(*row, format_captured(shares.get(row[0]))) for row in rows]
    )


def _scenario_table(results: Results) -> str:
    metrics = list_scalar_metrics()
    rows = [
        (
            name_episode(results.run, s),
            s.category,
            *format_scores(s),
            *_format_scalars(s, metrics),
            str(s.ticks),
            _endings(s),
        )
        for s in results.scenarios
    ]
    header = ("scenario", "category", *SCORE_HEADER, *(metric.label for metric in metrics), "ticks", "CAVs")
    return format_markdown_table(header, rows, left=2)


def _format_scalars(scenario: ScenarioResult, metrics: tuple[ScalarMetric, ...]) -> list[str]:
    return [_format_scalar(scenario.find_scalar(metric.name), metric) for metric in metrics]


def _format_scalar(value: float | None, metric: ScalarMetric) -> str:
    return "-" if value is None else f"{value:.{metric.decimals}f}"


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
