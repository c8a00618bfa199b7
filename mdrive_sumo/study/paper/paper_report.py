"""The study as a report: tables and figures with the words that say what they can be compared with."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from mdrive_sumo.core.tables import Table, make_row, make_text_columns
from mdrive_sumo.report.comparison_report.comparison_report import ComparisonReport, ReportSection
from mdrive_sumo.report.comparison_report.report_figures import make_level_figure
from mdrive_sumo.report.comparison_report.scenario_tables import (
    build_category_table,
    build_interdrive_table,
    build_level_table,
)
from mdrive_sumo.report.comparison_report.score_tables import build_bucket_table, build_main_table
from mdrive_sumo.report.published_results import (
    BUCKET_SIZES,
    PUBLISHED_LATENCY,
    PUBLISHED_METHODS,
    PUBLISHED_POSE_ERROR,
)
from mdrive_sumo.study.human.human_report import NO_PERSON, build_rq4_parts
from mdrive_sumo.study.human.human_results import HumanStudyResults
from mdrive_sumo.study.paper import section_texts
from mdrive_sumo.study.paper.cooperation_gain import PAIRS
from mdrive_sumo.study.paper.detector_order import build_detector_table, build_precision_correlations
from mdrive_sumo.study.paper.open_closed_table import (
    build_correlation_table,
    build_open_closed_table,
    make_open_closed_figure,
)
from mdrive_sumo.study.paper.paper_numbers import PaperNumbers
from mdrive_sumo.study.paper.paper_plan import LOG_BUCKET, PaperScale
from mdrive_sumo.study.paper.paper_study import CONDITIONS
from mdrive_sumo.study.paper.paper_tables import (
    build_channel_table,
    build_gap_table,
    build_pair_table,
    build_scenario_table,
)
from mdrive_sumo.study.paper.section_texts import SectionText

QUICK = "QUICK"
QUICK_WARNING = (
    f"{QUICK}: a few scenarios of every kind, to see what comes out. These numbers are no results:"
    " run the study without --quick for them."
)
CHOICES: Mapping[PaperScale, str] = MappingProxyType(
    {
        PaperScale.QUICK: "one of each InterDrive group, interactivity level or other category, and two of V2XPnP",
        PaperScale.STANDARD: "a quarter of each category, and five or more of each InterDrive group, interactivity"
        " level or other category",
        PaperScale.WHOLE: "all of the suite",
    }
)
TITLE = "The paper's tables and figures, measured with mdrive-sumo"
QUICK_PREFIX = "quick_"
NO_PRECISION = "Precision on test frames is not given: --detectors FILE."


@dataclass(frozen=True, slots=True)
class PaperRequest:
    """The study as the user asked for it, and what could not be part of it."""

    command: Sequence[str]
    left_out: Mapping[str, str]
    """Why built-in agents are left out, by agent."""
    humans: HumanStudyResults | None = None
    """A study with persons at the wheel (RQ4); None without one."""


def list_paper_facts(numbers: PaperNumbers, request: PaperRequest) -> dict[str, str]:
    """Return what was measured with what, by name."""
    run = numbers.compared[0].results.run
    plan = numbers.plan
    logs = LOG_BUCKET if any(scenario.bucket == LOG_BUCKET for scenario in numbers.scenarios) else "every bucket"
    options = ", ".join(f"{name} {value}" for name, value in run.conditions.items())
    return {
        "suite": f"{run.suite_label}, checksum {run.suite_checksum}",
        "scenarios": f"{len(plan.closed)}: {CHOICES[plan.scale]}",
        "open loop (RQ3)": f"{logs}: {len(plan.logs)} scenarios",
        "worse channels (RQ5)": f"{logs}: {len(plan.channel)} scenarios with two CAVs or more, evenly spaced in the"
        f" order of the suite: {', '.join(plan.channel)}",
        "seeds": ", ".join(map(str, run.all_seeds)),
        "agents": ", ".join(numbers.closed),
        "score mode": run.score_mode,
        "options": f"{options}, agent clock {run.agent_clock}",
        "command": shlex.join(request.command),
        "versions": ", ".join(f"{name} {version}" for name, version in sorted(run.versions.items())),
    }


def list_paper_warnings(numbers: PaperNumbers, request: PaperRequest) -> tuple[str, ...]:
    """Return what a reader must know before the numbers."""
    void = sum(results.void for results in numbers.runs)
    warnings = [QUICK_WARNING] if numbers.plan.scale is PaperScale.QUICK else []
    if not {*BUCKET_SIZES} & {*numbers.compared[0].results.buckets}:
        warnings.append(
            "These scenarios are of none of the paper's buckets: no published rows stand beside ours, and what the"
            " sections say of its scenarios and of V2XPnP does not hold here."
        )
    warnings += [f"Left out: {name}: {why}." for name, why in request.left_out.items()]
    warnings += [f"{void} episodes are void: a failure of the benchmark or of SUMO, not of an agent."] if void else []
    return tuple(warnings)


def build_paper_report(numbers: PaperNumbers, request: PaperRequest) -> ComparisonReport:
    """Return the report of a study; tables and figures of a quick one say so in title and name."""
    sections = (
        _make_section(section_texts.SCENARIOS, (build_scenario_table(numbers.scenarios),)),
        _make_section(section_texts.MAIN, _build_main_tables(numbers)),
        _build_category_section(numbers),
        _build_gain_section(numbers),
        _make_section(
            section_texts.CATEGORIES,
            tuple(build_category_table(numbers.compared, score) for score in ("ds", "sr", "h")),
        ),
        _build_open_closed_section(numbers),
        _build_human_section(request.humans),
        *_build_channel_sections(numbers),
        ReportSection("Without a counterpart", (_build_missing_table(),)),
    )
    if numbers.plan.scale is PaperScale.QUICK:
        sections = tuple(_mark_quick(section) for section in sections)
    return ComparisonReport(TITLE, list_paper_facts(numbers, request), list_paper_warnings(numbers, request), sections)


def _make_section(text: SectionText, tables: tuple[Table, ...] = ()) -> ReportSection:
    return ReportSection(text.title, tables, points=text.list_points())


def _build_main_tables(numbers: PaperNumbers) -> tuple[Table, ...]:
    published = PUBLISHED_METHODS if _drives_paper_buckets(numbers) else ()
    main = build_main_table(numbers.compared, published)
    if published and numbers.plan.scale is not PaperScale.WHOLE:
        whole = sum(BUCKET_SIZES.values())
        main = replace(
            main, note=f"{main.note} They are means over all {whole} scenarios; ours are over a share of each category."
        )
    return main, build_bucket_table(numbers.compared)


def _drives_paper_buckets(numbers: PaperNumbers) -> bool:
    """Return whether published rows may stand beside ours: not in a quick study, and not beside other buckets."""
    buckets = {*numbers.compared[0].results.buckets}
    return numbers.plan.scale is not PaperScale.QUICK and buckets == {*BUCKET_SIZES}


def _build_category_section(numbers: PaperNumbers) -> ReportSection:
    tables = (
        build_level_table(numbers.compared),
        build_interdrive_table(numbers.compared),
        *(build_gap_table(gaps) for gaps in (numbers.gaps, numbers.learned_gaps) if gaps),
    )
    figure = make_level_figure(numbers.compared)
    section = _make_section(section_texts.CATEGORY_FIGURE, tuple(table for table in tables if table))
    return replace(section, figures=(figure,) if figure else ())


def _build_gain_section(numbers: PaperNumbers) -> ReportSection:
    tables = [build_pair_table(numbers.gains)] if numbers.gains else []
    if numbers.learned_gains:
        tables.append(build_pair_table(numbers.learned_gains, "gains_learned", "learned perception"))
    if tables:
        return _make_section(section_texts.GAINS, tuple(tables))
    pairs = "; ".join(" and ".join(pair) for pair in PAIRS)
    missing = f"No pair of agents with one planner is in this study. Pairs are: {pairs}."
    return replace(_make_section(section_texts.GAINS), note=missing)


def _build_open_closed_section(numbers: PaperNumbers) -> ReportSection:
    tables = [build_open_closed_table(numbers.comparison), build_correlation_table(numbers.comparison)]
    if numbers.detectors:
        table = build_detector_table(numbers.detectors, numbers.precisions)
        given = "" if numbers.precisions else NO_PRECISION
        tables.append(replace(table, note=f"{table.note} {given}".strip()))
    if numbers.precision_correlations:
        tables.append(build_precision_correlations(numbers.precision_correlations))
    section = _make_section(section_texts.OPEN_CLOSED, tuple(tables))
    return replace(section, figures=(make_open_closed_figure(numbers.comparison),))


def _build_human_section(humans: HumanStudyResults | None) -> ReportSection:
    section = _make_section(section_texts.HUMANS)
    if humans is None:
        return replace(section, note=f"{NO_PERSON}: no study folder is given (--human-study DIR).")
    tables, figures = build_rq4_parts(humans)
    return replace(section, tables=tables, figures=figures, note="" if humans.persons else NO_PERSON)


def _build_channel_sections(numbers: PaperNumbers) -> Sequence[ReportSection]:
    clean, *perturbed = CONDITIONS
    parts = (
        ("latency", "Latency of 6 ticks", section_texts.LATENCY, PUBLISHED_LATENCY),
        ("pose_error", "Pose error of 0.6 m and 0.6°", section_texts.POSE_ERROR, PUBLISHED_POSE_ERROR),
    )
    has_logs = any(scenario.bucket == LOG_BUCKET for scenario in numbers.scenarios)
    sections: list[ReportSection] = []
    for (name, title, text, published), condition in zip(parts, perturbed, strict=True):
        rows = published if has_logs else ()
        table = build_channel_table(name, title, numbers.channel, (clean, condition), rows)
        sections.append(_make_section(text, (table,)))
    return sections


def _build_missing_table() -> Table:
    columns = make_text_columns({"item": "of the paper", "reason": "why the study has no counterpart"})
    rows = tuple(make_row(row) for row in section_texts.NO_COUNTERPART.items())
    return Table("without_counterpart", "Tables and figures of the paper without a counterpart", columns, rows)


def _mark_quick(section: ReportSection) -> ReportSection:
    """Return a section whose tables and figures are marked as those of a quick study."""
    tables, figures = (
        tuple(replace(item, name=f"{QUICK_PREFIX}{item.name}", title=f"{QUICK}: {item.title}") for item in items)
        for items in (section.tables, section.figures)
    )
    return replace(section, tables=tables, figures=figures)
