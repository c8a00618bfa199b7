"""The index of a converted suite: a line for every scenario, what misses its targets first."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from mdrive_sumo.scenario.suite import natural_sort_key
from real2sim.fidelity_report.formatting import measured, share
from real2sim.fidelity_report.html import Html, joined, page, table, tag
from real2sim.fidelity_report.map_figures import plan_of, thumbnail
from real2sim.fidelity_report.report_entry import things_of
from real2sim.fidelity_report.report_page import PAGE
from real2sim.fidelity_report.target_tiles import missed
from real2sim.findings import ConversionFindings
from real2sim.targets import count_sumo_driven

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
class IndexLine:
    """What the index tells of one scenario; small enough to come back from a worker."""

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
    picture: Html | None = None
    """A small map."""


def index_line(findings: ConversionFindings) -> IndexLine:
    """The line of one scenario."""
    quality, closeness = findings.quality, findings.closeness
    things = things_of(findings)
    return IndexLine(
        findings.id,
        findings.recording.source,
        missed(findings),
        quality.moving_passed,
        quality.moving_vehicles,
        count_sumo_driven(quality, findings.roles, findings.mode),
        quality.error_median,
        quality.error_p95,
        quality.jerk_p95,
        closeness.median_at_5s if closeness else None,
        closeness.order_share if closeness else None,
        thumbnail(plan_of(things), findings.roads, things),
    )


def write_index(suite: Path, name: str, lines: Sequence[IndexLine]) -> Path:
    """Writes `conversion.html` into the suite's folder."""
    path = suite / PAGE
    path.write_text(index_html(name, lines), encoding="utf-8")
    return path


def index_html(name: str, lines: Sequence[IndexLine]) -> str:
    """The index as text."""
    ordered = sorted(lines, key=lambda line: (not line.misses, natural_sort_key(line.id)))
    faithful = sum(not line.misses for line in lines)
    passed, moving = sum(line.passed for line in lines), sum(line.moving for line in lines)
    words = (
        f"{faithful} of {len(lines)} scenarios meet every target."
        f" {passed} of {moving} moving vehicles ({share(passed / moving if moving else None)}) pass every check."
    )
    title = f"{name} · conversion"
    state = "met" if faithful == len(lines) else "missed"
    return page(
        title,
        tag("header", tag("h1", title), tag("p", tag("strong", words), class_=f"verdict {state}")),
        tag("main", tag("section", table(HEAD, map(_row, ordered), "Scenarios", words=4), aria_label="Scenarios")),
    )


def _row(line: IndexLine) -> tuple[Html | str | None, ...]:
    return (
        line.picture,
        tag("a", line.id, href=f"{quote(line.id, safe='')}/{PAGE}"),
        _verdict(line),
        line.source,
        f"{line.passed} of {line.moving}",
        f"{line.by_sumo} of {line.moving}",
        measured(line.error_median),
        measured(line.error_p95),
        measured(line.jerk_p95, decimals=1),
        measured(line.median_at_5s),
        share(line.order_share),
    )


def _verdict(line: IndexLine) -> Html:
    if not line.misses:
        return tag("span", "faithful", class_="badge pass")
    misses = tag("ul", *(tag("li", miss) for miss in line.misses))
    return joined((tag("span", f"misses {len(line.misses)}", class_="badge fail"), misses))
