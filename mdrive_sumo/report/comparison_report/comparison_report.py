"""ComparisonReport: everything that a report over several runs shows, as values."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import Table
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.comparison_report.cooperation_table import build_cooperation_table
from mdrive_sumo.report.comparison_report.difference_tables import (
    build_bucket_difference_table,
    build_difference_table,
    compute_differences,
)
from mdrive_sumo.report.comparison_report.outcome_tables import (
    build_infraction_table,
    build_outcome_table,
    build_scalar_table,
)
from mdrive_sumo.report.comparison_report.provenance_table import build_provenance_table, list_facts, list_warnings
from mdrive_sumo.report.comparison_report.ranking_table import NEEDS_AGENTS, build_ranking_table
from mdrive_sumo.report.comparison_report.report_figures import (
    ReportFigure,
    make_difference_figure,
    make_distribution_figure,
    make_level_figure,
    make_scenario_figure,
)
from mdrive_sumo.report.comparison_report.scenario_tables import (
    build_category_table,
    build_distribution_table,
    build_interdrive_table,
    build_level_table,
    build_scenario_table,
)
from mdrive_sumo.report.comparison_report.score_tables import build_bucket_table, build_main_table
from mdrive_sumo.report.published_results import PUBLISHED_METHODS, check_published_rows


@dataclass(frozen=True, slots=True)
class ReportSection:
    """A heading with figures and tables. `note` stands where something cannot be shown, and says what it needs."""

    title: str
    tables: tuple[Table, ...] = ()
    figures: tuple[ReportFigure, ...] = ()
    note: str = ""
    points: Mapping[str, str] = field(default_factory=dict[str, str])
    """What there is to say about it, each under its own short heading."""


@dataclass(frozen=True, slots=True)
class ComparisonReport:
    """A report over several runs."""

    title: str
    facts: Mapping[str, str]
    warnings: tuple[str, ...]
    sections: tuple[ReportSection, ...]

    @property
    def tables(self) -> tuple[Table, ...]:
        """All tables, in their order."""
        return tuple(table for section in self.sections for table in section.tables)

    @property
    def figures(self) -> tuple[ReportFigure, ...]:
        """All figures, in their order."""
        return tuple(figure for section in self.sections for figure in section.figures)


def build_comparison_report(
    agents: Sequence[ComparedAgent],
    *,
    baseline: str = "",
    with_published: bool = False,
    command: Sequence[str] = (),
) -> ComparisonReport:
    """Return the report of agents.

    baseline: name of the agent that all others are compared with; by default every agent is with every other.
    with_published: whether the main table has the rows of the paper, set apart. command: what the report is made by.

    Raises InputError for an unknown baseline, and if the published rows are of another suite.
    """
    if not agents:
        raise InputError("report: expected at least one run, found none")
    if with_published:
        check_published_rows(agents[0].results)
    published = PUBLISHED_METHODS if with_published else ()
    made_by = f"Command: {shlex.join(command)}" if command else ""
    sections = (
        ReportSection("Scores", (build_main_table(agents, published), build_bucket_table(agents))),
        _make_ranking_section(agents),
        _make_category_section(agents),
        _make_difference_section(agents, baseline),
        ReportSection("Outcomes and infractions", (build_outcome_table(agents), build_infraction_table(agents))),
        ReportSection(
            "Distribution of the driving score",
            (build_distribution_table(agents),),
            (make_distribution_figure(agents),),
        ),
        _make_cooperation_section(agents),
        ReportSection("Efficiency and comfort", (build_scalar_table(agents),)),
        _make_scenario_section(agents),
        ReportSection("Provenance", (build_provenance_table(agents),), note=made_by),
    )
    return ComparisonReport(_make_title(agents), list_facts(agents), list_warnings(agents), sections)


def _make_title(agents: Sequence[ComparedAgent]) -> str:
    names = ", ".join(agent.name for agent in agents) if len(agents) <= 3 else f"{len(agents)} agents"
    return f"{agents[0].results.run.suite_label}: {names}"


def _make_ranking_section(agents: Sequence[ComparedAgent]) -> ReportSection:
    table = build_ranking_table(agents)
    return ReportSection("Ranking by item response", (table,) if table else (), note="" if table else NEEDS_AGENTS)


def _make_category_section(agents: Sequence[ComparedAgent]) -> ReportSection:
    groups = (build_level_table(agents), build_interdrive_table(agents))
    categories = (build_category_table(agents, score) for score in ("h", "ds", "sr"))
    figure = make_level_figure(agents)
    note = "" if figure else "No scenario has one of the three interactivity levels, which the category figure shows."
    tables = (*(table for table in groups if table), *categories)
    return ReportSection("Categories", tables, (figure,) if figure else (), note)


def _make_difference_section(agents: Sequence[ComparedAgent], baseline: str) -> ReportSection:
    title = f"Differences to {baseline}" if baseline else "Differences"
    differences = compute_differences(agents, baseline)
    if not differences:
        return ReportSection(title, note="Differences need runs of two agents, or of two settings of one.")
    by_bucket = build_bucket_difference_table(differences)
    figure = make_difference_figure(differences)
    return ReportSection(
        title,
        (build_difference_table(differences), *((by_bucket,) if by_bucket else ())),
        (figure,) if figure else (),
    )


def _make_cooperation_section(agents: Sequence[ComparedAgent]) -> ReportSection:
    table = build_cooperation_table(agents)
    missing = (
        "Captured cooperation needs, beside an agent's run, one of the same agent with --comm off and one of omniscient"
        " with the same options and seeds."
    )
    return ReportSection("Captured cooperation", (table,) if table else (), note="" if table else missing)


def _make_scenario_section(agents: Sequence[ComparedAgent]) -> ReportSection:
    matrix = build_scenario_table(agents)
    return ReportSection("Scenarios", (matrix, build_scenario_table(agents, "sr")), (make_scenario_figure(matrix),))
