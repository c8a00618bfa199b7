"""Index page of a converted suite: one row per scenario, those that miss targets first."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.scenario.suite import natural_sort_key
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.formatting import format_figure, format_share
from real2sim.fidelity_report.html import Markup, join_markup, render_list, render_page, render_table, tag
from real2sim.fidelity_report.map_figures import draw_thumbnail, fit_map_frame
from real2sim.fidelity_report.report_entry import build_entries
from real2sim.fidelity_report.report_page import PAGE
from real2sim.fidelity_report.target_tiles import find_missed_targets
from real2sim.fidelity_targets import count_sumo_driven

HEAD = (
    "map",
    "scenario",
    "verdict",
    "source",
    "moving vehicles pass",
    "driven by SUMO",
    "median [m]",
    "p95 [m]",
    "jerk p95 [m/s³]",
    "off the log at 5 s [m]",
    "order kept",
)


@dataclass(frozen=True, slots=True)
class IndexRow:
    """Row of one scenario; small enough to be sent from a worker process."""

    id: str
    source: str
    misses: tuple[str, ...]
    passed: int
    moving: int
    by_sumo: int
    error_median: float | None
    error_p95: float | None
    jerk_p95: float
    median_at_5s: float | None = None
    order_share: float | None = None
    picture: Markup | None = None
    """Thumbnail map."""


def build_index_row(findings: ConversionFindings) -> IndexRow:
    """Return the row of one scenario."""
    quality, closeness = findings.quality, findings.closeness
    entries = build_entries(findings)
    return IndexRow(
        findings.id,
        findings.recording.source,
        find_missed_targets(findings),
        quality.moving_passed,
        quality.moving_vehicles,
        count_sumo_driven(quality, findings.roles, findings.mode),
        quality.error_median,
        quality.error_p95,
        quality.jerk_p95,
        closeness.median_at_5s if closeness else None,
        closeness.order_share if closeness else None,
        draw_thumbnail(fit_map_frame(entries), findings.roads, entries),
    )


def write_index(suite: Path, name: str, lines: Sequence[IndexRow]) -> Path:
    """Write `conversion.html` into the suite's folder."""
    path = suite / PAGE
    write_text(path, render_index(name, lines))
    return path


def render_index(name: str, lines: Sequence[IndexRow]) -> str:
    """Return the index page as text."""
    ordered = sorted(lines, key=lambda line: (not line.misses, natural_sort_key(line.id)))
    faithful = sum(not line.misses for line in lines)
    passed, moving = sum(line.passed for line in lines), sum(line.moving for line in lines)
    words = (
        f"{faithful} of {len(lines)} scenarios meet every target."
        f" {passed} of {moving} moving vehicles ({format_share(passed / moving if moving else None)}) pass every check."
    )
    title = f"{name} · conversion"
    state = "met" if faithful == len(lines) else "missed"
    return render_page(
        title,
        tag("header", tag("h1", title), tag("p", tag("strong", words), class_=f"verdict {state}")),
        tag(
            "main",
            tag(
                "section",
                render_table(HEAD, map(_table_row, ordered), "Scenarios", text_columns=4),
                aria_label="Scenarios",
            ),
        ),
    )


def _table_row(line: IndexRow) -> tuple[Markup | str | None, ...]:
    return (
        line.picture,
        tag("a", line.id, href=f"{quote(line.id, safe='')}/{PAGE}"),
        _render_verdict(line),
        line.source,
        f"{line.passed} of {line.moving}",
        f"{line.by_sumo} of {line.moving}",
        format_figure(line.error_median),
        format_figure(line.error_p95),
        format_figure(line.jerk_p95, decimals=1),
        format_figure(line.median_at_5s),
        format_share(line.order_share),
    )


def _render_verdict(line: IndexRow) -> Markup:
    if not line.misses:
        return tag("span", "faithful", class_="badge pass")
    badge = tag("span", f"misses {len(line.misses)}", class_="badge fail")
    return join_markup((badge, render_list(line.misses)))
