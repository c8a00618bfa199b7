"""The sections of the study's pages: tables and figures with the words that say what they can be compared with."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from mdrive_sumo.report.comparison_report.category_tables import (
    build_category_table,
    build_interdrive_table,
    build_level_table,
)
from mdrive_sumo.report.comparison_report.report_table import ReportTable
from mdrive_sumo.report.comparison_report.score_tables import build_bucket_table, build_main_table
from mdrive_sumo.report.published_results import (
    BUCKET_SIZES,
    PUBLISHED_LATENCY,
    PUBLISHED_METHODS,
    PUBLISHED_POSE_ERROR,
)
from mdrive_sumo.study.paper import section_texts
from mdrive_sumo.study.paper.channel_table import build_channel_table
from mdrive_sumo.study.paper.gain_tables import build_gap_table, build_pair_table
from mdrive_sumo.study.paper.open_closed_table import build_correlation_table, build_open_closed_table
from mdrive_sumo.study.paper.paper_numbers import PaperNumbers
from mdrive_sumo.study.paper.paper_study import CONDITIONS
from mdrive_sumo.study.paper.scenario_table import build_scenario_table
from mdrive_sumo.study.paper.section_texts import SectionText

CATEGORY_FIGURE = "category_figure"
OPEN_CLOSED_FIGURE = "open_closed_figure"
QUICK = "QUICK"


@dataclass(frozen=True, slots=True)
class PaperSection:
    """A part of the study. figures: stems of the files."""

    text: SectionText
    tables: tuple[ReportTable, ...] = ()
    figures: tuple[str, ...] = ()


def build_sections(numbers: PaperNumbers) -> tuple[PaperSection, ...]:
    """Return all sections; the tables of a quick study say so in title and name."""
    sections = (
        PaperSection(section_texts.SCENARIOS, (build_scenario_table(numbers.scenarios),)),
        PaperSection(section_texts.MAIN, _build_main_tables(numbers)),
        _build_category_section(numbers),
        PaperSection(section_texts.GAINS, (build_pair_table(numbers.gains),) if numbers.gains else ()),
        PaperSection(
            section_texts.CATEGORIES,
            tuple(build_category_table(numbers.compared, score) for score in ("ds", "sr", "h")),
        ),
        PaperSection(
            section_texts.OPEN_CLOSED,
            (build_open_closed_table(numbers.comparison), build_correlation_table(numbers.comparison)),
            (OPEN_CLOSED_FIGURE,),
        ),
        PaperSection(section_texts.HUMANS),
        *_build_channel_sections(numbers),
    )
    return tuple(_mark_quick(section) for section in sections) if numbers.plan.quick else sections


def _build_main_tables(numbers: PaperNumbers) -> tuple[ReportTable, ...]:
    published = PUBLISHED_METHODS if _drives_whole_buckets(numbers) else ()
    return build_main_table(numbers.compared, published), build_bucket_table(numbers.compared)


def _drives_whole_buckets(numbers: PaperNumbers) -> bool:
    """Return whether the published rows are means over as many scenarios of the same buckets."""
    buckets = numbers.compared[0].results.buckets
    return {name: bucket.scenarios for name, bucket in buckets.items()} == dict(BUCKET_SIZES)


def _build_category_section(numbers: PaperNumbers) -> PaperSection:
    tables = (
        build_level_table(numbers.compared),
        build_interdrive_table(numbers.compared),
        build_gap_table(numbers.gaps) if numbers.gaps else None,
    )
    figures = (CATEGORY_FIGURE,) if tables[0] else ()
    return PaperSection(section_texts.CATEGORY_FIGURE, tuple(table for table in tables if table), figures)


def _build_channel_sections(numbers: PaperNumbers) -> Sequence[PaperSection]:
    clean, *perturbed = CONDITIONS
    parts = (
        ("latency", section_texts.LATENCY, PUBLISHED_LATENCY),
        ("pose_error", section_texts.POSE_ERROR, PUBLISHED_POSE_ERROR),
    )
    return [
        PaperSection(
            text,
            (
                build_channel_table(
                    name, f"{condition.name}, clean and perturbed", numbers.channel, (clean, condition), published
                ),
            ),
        )
        for (name, text, published), condition in zip(parts, perturbed, strict=True)
    ]


def _mark_quick(section: PaperSection) -> PaperSection:
    tables = [replace(one, name=f"quick_{one.name}", title=f"{QUICK}: {one.title}") for one in section.tables]
    return replace(section, tables=tuple(tables), figures=tuple(f"quick_{figure}" for figure in section.figures))
