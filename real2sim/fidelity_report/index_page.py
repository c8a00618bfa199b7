"""Index page of a converted suite: one row per scenario, those that miss targets first."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import quote

from markupsafe import Markup

from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.scenario.suite import natural_sort_key
from real2sim.conversion_findings import ConversionFindings
from real2sim.fidelity_report.formatting import format_figure, format_share
from real2sim.fidelity_report.html import PAGE, render_page
from real2sim.fidelity_report.map_figures import draw_thumbnail, fit_map_frame
from real2sim.fidelity_report.report_entry import build_entries

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
    """One sentence for each missed target."""
    passed: int
    """Number of moving vehicles that pass every check."""
    moving: int
    """Number of moving vehicles."""
    by_sumo: int
    """Number of moving vehicles that SUMO drives."""
    error_median: float | None
    error_p95: float | None
    """[m] Distance of the reconstruction to the log."""
    jerk_p95: float
    """95th percentile of the jerk [m/s³] of the reconstructed tracks."""
    median_at_5s: float | None = None
    """[m] Distance of the traffic to the log 5 s after departure."""
    order_share: float | None = None
    """Share of pairs that pass their conflict point in the log's order."""
    picture: Markup | None = None
    """Thumbnail map as SVG; None draws nothing."""

    def format_figures(self) -> tuple[str, ...]:
        """Return the cells after the source."""
        return (
            f"{self.passed} of {self.moving}",
            f"{self.by_sumo} of {self.moving}",
            format_figure(self.error_median),
            format_figure(self.error_p95),
            format_figure(self.jerk_p95, decimals=1),
            format_figure(self.median_at_5s),
            format_share(self.order_share),
        )


def build_index_row(findings: ConversionFindings) -> IndexRow:
    """Return the row of one scenario."""
    quality, closeness = findings.quality, findings.closeness
    entries = build_entries(findings)
    return IndexRow(
        findings.id,
        findings.recording.source,
        findings.misses,
        quality.moving_passed,
        quality.moving_vehicles,
        findings.sumo_driven,
        quality.error_median,
        quality.error_p95,
        quality.jerk_p95,
        closeness.median_at_5s if closeness else None,
        closeness.order_share if closeness else None,
        draw_thumbnail(fit_map_frame(entries), findings.roads, entries),
    )


def write_index(suite: Path, name: str, rows: Sequence[IndexRow]) -> Path:
    """Write `conversion.html` into the suite's folder."""
    path = suite / PAGE
    write_text(path, render_index(name, rows))
    return path


def render_index(name: str, rows: Sequence[IndexRow]) -> str:
    """Return the index page as text."""
    passed, moving = sum(row.passed for row in rows), sum(row.moving for row in rows)
    return render_page(
        "index.html",
        f"{name} · conversion",
        head=HEAD,
        quote=partial(quote, safe=""),
        rows=sorted(rows, key=lambda row: (not row.misses, natural_sort_key(row.id))),
        faithful=sum(not row.misses for row in rows),
        passed=passed,
        moving=moving,
        share=format_share(passed / moving if moving else None),
    )
