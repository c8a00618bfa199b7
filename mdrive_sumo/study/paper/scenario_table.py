"""The scenarios that were driven, beside the paper's tables of scenario distribution."""

from collections.abc import Sequence

from mdrive_sumo.core.tables import Column, Row, Table, make_row
from mdrive_sumo.scenario.categories import FIGURES, Category
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.statistics import PAPER, compute_suite_statistics

COLUMNS = {
    "scenarios": ("scenarios", 0),
    "cavs": ("CAVs", 2),
    "route_m": ("route [m]", 2),
    "heading_change_deg": ("heading change [deg]", 2),
    "actors": ("actors", 2),
}
BUCKETS, CATEGORIES = "bucket", "category of Interaction"


def build_scenario_table(scenarios: Sequence[Scenario]) -> Table:
    """Return statistics by bucket and by Interaction's category, with the paper's numbers beside them."""
    columns = [Column("group", "")]
    for source in ("driven", "paper"):
        columns += [Column(f"{key}_{source}", *_label(key, source)) for key in COLUMNS]
    rows = [
        _make_row(bucket, [one for one in scenarios if one.bucket == bucket], _find_paper_bucket(bucket), BUCKETS)
        for bucket in dict.fromkeys(scenario.bucket for scenario in scenarios)
    ]
    for category in Category:
        if found := [one for one in scenarios if one.category == category]:
            figures = FIGURES.get(category)
            paper = (float(figures.count), *figures.means) if figures else (None,) * len(COLUMNS)
            rows.append(_make_row(category, found, paper, CATEGORIES))
    note = "Means over scenarios, of routes and heading changes over CAVs. Actors: road users and props besides CAVs."
    return Table("scenarios", "Scenarios driven, and those of the paper", tuple(columns), tuple(rows), note)


def _label(key: str, source: str) -> tuple[str, str, int]:
    label, decimals = COLUMNS[key]
    return label, source, decimals


def _find_paper_bucket(bucket: str) -> tuple[float | None, ...]:
    found = PAPER.get(bucket.lower())
    if found is None:
        return (None,) * len(COLUMNS)
    means = (found.mean_cavs, found.mean_route_m, found.mean_heading_change_deg, found.mean_actors)
    return (float(found.scenarios), *means)


def _make_row(name: str, scenarios: Sequence[Scenario], paper: Sequence[float | None], section: str) -> Row:
    found = compute_suite_statistics(scenarios)
    means = (found.mean_cavs, found.mean_route_m, found.mean_heading_change_deg, found.mean_actors)
    return make_row((name, float(found.scenarios), *means, *paper), section)
