"""The tables of `convert --realism`: for the terminal and as JSON."""

import json
from collections.abc import Sequence
from dataclasses import asdict

from mdrive_sumo.core.tables import format_text, make_text_table
from real2sim.traffic_fidelity.realism_score import COLLISIONS, FEATURES
from real2sim.traffic_fidelity.traffic_realism import RealismRow, RealismTable

LABELS = {"realism": "realism", **{feature.name: feature.title for feature in FEATURES}, COLLISIONS: COLLISIONS}


def format_realism(table: RealismTable) -> str:
    """Return both tables as text."""
    return "\n".join(
        (
            f"{table.scenarios} scenarios, {table.vehicles} vehicles driven by SUMO,"
            f" {table.seconds:.0f} vehicle seconds, {table.rollouts} rollouts",
            "",
            "Each vehicle under histograms of its own rollouts:",
            _format_rows(table.rows),
            "",
            "All vehicles under one histogram of all:",
            _format_rows(table.pooled),
            "",
            "Likelihoods from 0 to 1, larger is more like the log; realism is their weighted mean (docs/traffic.md).",
        )
    )


def _format_rows(rows: Sequence[RealismRow]) -> str:
    cells = [
        (row.traffic, f"{row.realism:.3f}", *(_format_share(row, name) for name in LABELS if name != "realism"))
        for row in rows
    ]
    return format_text(make_text_table(("traffic", *LABELS.values()), cells))


def _format_share(row: RealismRow, name: str) -> str:
    return f"{row.likelihoods[name]:.3f}" if name in row.likelihoods else "-"


def dump_realism(table: RealismTable) -> str:
    """Return both tables as JSON."""
    return json.dumps(asdict(table), indent=1)
