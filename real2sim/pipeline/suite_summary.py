"""Fidelity of a suite: the figures of all its quality.json files in one table, and the missed targets."""

from collections.abc import Callable, Mapping, Sequence
from statistics import median
from typing import Any

from pydantic import BaseModel, ConfigDict

from real2sim.pipeline.quality_file import QualityFile

HEAD = (
    *("scenario", "moving ok", "by SUMO", "median", "p95", "jerk", "wrong", "spawn", "twice", "jumps", "overlap"),
    *("5 s", "worst", "touch", "order", "stalled", "drive", "verdict"),
)
LEGEND = (
    "moving ok: moving vehicles that pass all checks; by SUMO: moving vehicles that SUMO drives, the others are CAVs or"
    " scripted; median, p95: raw against reconstructed [m]; jerk: p95 [m/s3];"
    " wrong: frames against the lane; spawn: overlaps at the start; twice: duplicate tracks; jumps: over 1 m;"
    " overlap: pairs of reconstructed boxes that overlap later (no target);"
    " 5 s, worst: traffic off the log after 5 s [m], median and worst vehicle; touch: pairs of background vehicles that"
    " overlap in SUMO but not in the log (no target); order: kept at conflicts; stalled: background vehicles that"
    ' stand far longer than in the log, "-": not looked for;'
    " drive: infractions of the CAVs' logged drives, unconfirmed + confirmed.\n"
    "The last row: sums of counts; median, p95, jerk and worst of the worst scenario; 5 s of the median scenario."
)

COMBINE: Mapping[str, Callable[[Sequence[Any]], Any]] = {
    **dict.fromkeys(("error_median", "error_p95", "jerk_p95", "worst_at_5s"), max),
    "median_at_5s": median,
    "passed": all,
}
"""How a figure of all scenarios follows from theirs; the others, which are counts, are summed."""


class FidelityRow(BaseModel):
    """Figures of one scenario, or of all together."""

    model_config = ConfigDict(frozen=True)

    scenario: str
    moving_passed: int
    moving_vehicles: int
    by_sumo: int
    error_median: float | None
    error_p95: float | None
    jerk_p95: float
    wrong_way_frames: int
    spawn_overlaps: int
    duplicates: int
    teleports: int
    median_at_5s: float | None
    worst_at_5s: float | None
    collisions: int
    """Pairs of reconstructed boxes that overlap after the start, mostly as in the log; no target."""
    contacts: int
    """Pairs of background vehicles that overlap in SUMO but not in the log; no target."""
    order_kept: int
    order_pairs: int
    stalled: int | None
    """Background vehicles that stall when the scenario is driven; None if the conversion did not look."""
    logged_infractions: int
    """Infractions of the CAVs' logged drives that no person has confirmed."""
    confirmed_infractions: int
    passed: bool


class FidelitySummary(BaseModel):
    """Figures of a suite."""

    model_config = ConfigDict(frozen=True)

    scenarios: tuple[FidelityRow, ...]
    all: FidelityRow
    """Sums of counts; of errors, jerk and `worst_at_5s` the worst scenario, of `median_at_5s` the median scenario."""
    misses: dict[str, dict[str, str]]
    """Name of the figure -> scenario -> sentence."""


def summarize_suite(qualities: Sequence[QualityFile]) -> FidelitySummary:
    """Aggregate at least one quality.json."""
    lines = tuple(map(_build_row, qualities))
    misses: dict[str, dict[str, str]] = {}
    for quality in qualities:
        for target in quality.targets:
            if target.met is False:
                misses.setdefault(target.name, {})[quality.scenario] = target.format_sentence()
    return FidelitySummary(scenarios=lines, all=_aggregate(lines), misses=misses)


def _build_row(quality: QualityFile) -> FidelityRow:
    fidelity, close = quality.fidelity, quality.closeness
    return FidelityRow(
        scenario=quality.scenario,
        moving_passed=fidelity.moving_passed,
        moving_vehicles=fidelity.moving_vehicles,
        by_sumo=quality.by_sumo,
        error_median=fidelity.error_median,
        error_p95=fidelity.error_p95,
        jerk_p95=fidelity.jerk_p95,
        wrong_way_frames=fidelity.wrong_way_frames,
        spawn_overlaps=len(fidelity.spawn_overlaps),
        duplicates=len(fidelity.duplicates),
        teleports=fidelity.teleports,
        median_at_5s=close.median_at_5s,
        worst_at_5s=next((error.worst for error in close.errors if error.after_s == 5.0), None),
        collisions=len(fidelity.collisions),
        contacts=len(close.contacts),
        order_kept=close.order_kept,
        order_pairs=close.order_pairs,
        stalled=None if quality.stalled is None else len({vehicle.id for vehicle in quality.stalled}),
        logged_infractions=len(quality.logged_drive.unconfirmed) if quality.logged_drive else 0,
        confirmed_infractions=quality.logged_drive.confirmed_count if quality.logged_drive else 0,
        passed=quality.passed,
    )


def _aggregate(rows: Sequence[FidelityRow]) -> FidelityRow:
    """Combine the rows, see `FidelitySummary.all`; what no scenario has measured stays None."""
    combined: dict[str, Any] = {"scenario": f"all {len(rows)}"}
    for name in FidelityRow.model_fields.keys() - combined.keys():
        values = [value for row in rows if (value := getattr(row, name)) is not None]
        combined[name] = COMBINE.get(name, sum)(values) if values else None
    return FidelityRow(**combined)


def format_summary(summary: FidelitySummary) -> str:
    """For a terminal: a line for each scenario, all together, then what misses its target."""
    rows = [HEAD, *map(_format_cells, (*summary.scenarios, summary.all))]
    widths = [max(len(row[i]) for row in rows) for i in range(len(HEAD))]
    lines = [
        "  ".join(
            cell.ljust(width) if title in ("scenario", "verdict") else cell.rjust(width)
            for title, cell, width in zip(HEAD, row, widths, strict=True)
        ).rstrip()
        for row in rows
    ]
    misses = [f"{scenario}: {text}" for missed in summary.misses.values() for scenario, text in missed.items()]
    return "\n".join((*lines, "", LEGEND, "", *(misses or ["Every figure meets its target."])))


def _format_cells(line: FidelityRow) -> tuple[str, ...]:
    return (
        line.scenario,
        f"{line.moving_passed}/{line.moving_vehicles}",
        f"{line.by_sumo}/{line.moving_vehicles}",
        _number(line.error_median, 3),
        _number(line.error_p95, 3),
        _number(line.jerk_p95, 2),
        *map(str, (line.wrong_way_frames, line.spawn_overlaps, line.duplicates, line.teleports, line.collisions)),
        _number(line.median_at_5s, 2),
        _number(line.worst_at_5s, 2),
        str(line.contacts),
        f"{line.order_kept}/{line.order_pairs}",
        _number(line.stalled, 0),
        f"{line.logged_infractions}+{line.confirmed_infractions}",
        "passed" if line.passed else "misses",
    )


def _number(value: float | None, decimals: int) -> str:
    return "-" if value is None else f"{value:.{decimals}f}"
