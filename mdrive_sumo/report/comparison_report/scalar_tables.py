"""Efficiency and comfort beside the score: the scalars of results format 4, by bucket and over all scenarios."""

from collections.abc import Mapping, Sequence

from mdrive_sumo.core.tables import CellValue, Column, Row, Table, make_row
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.comparison_report.published_rows import order_buckets
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.scoring.metrics import ScalarMetric, list_scalar_metrics
from mdrive_sumo.scoring.summary import compute_mean_of_known, compute_scalar_means

ALL_SCENARIOS = "all scenarios"
SCALAR_NOTE = (
    "No score depends on these, and they are not ranked. Means over the episodes in which each is defined. Time ratio:"
    " time needed divided by that of omniscient, where every CAV arrives. Close calls: percent of the episodes whose"
    " time to contact falls below 1.8 s, and the mean of its minimum in these. Minimum PET: least time from when a CAV"
    " or another road user leaves a place until the other takes it, at most 5 s. Comfort: share of time within nuPlan's"
    " bounds. Messages: payload that all stations send in a second."
)
MIN_TTC = "min_ttc"


def build_scalar_table(agents: Sequence[ComparedAgent], name: str = "efficiency") -> Table:
    """Return time ratio, close calls and the scalar metrics of every agent by bucket and over all scenarios."""
    metrics = [metric for metric in list_scalar_metrics() if metric.name != MIN_TTC]
    ttc = next(metric for metric in list_scalar_metrics() if metric.name == MIN_TTC)
    columns = (
        Column("agent", "Agent"),
        Column("time_ratio", "time ratio"),
        Column("close_calls", "close calls [%]", decimals=1),
        Column(ttc.name, ttc.label, decimals=ttc.decimals),
        *(Column(metric.name, metric.label, decimals=metric.decimals) for metric in metrics),
    )
    rows: list[Row] = []
    for group in _list_groups(agents[0]):
        for agent in agents:
            scenarios = _select_episodes(agent, group)
            rows.append(make_row((agent.name, *_compute_values(scenarios, metrics)), group))
    return Table(name, "Efficiency and comfort", columns, tuple(rows), SCALAR_NOTE)


def _list_groups(agent: ComparedAgent) -> tuple[str, ...]:
    buckets = order_buckets(agent.results.buckets)
    return (*buckets, ALL_SCENARIOS) if len(buckets) > 1 else buckets


def _select_episodes(agent: ComparedAgent, group: str) -> Sequence[ScenarioResult]:
    return [one for one in agent.results.scenarios if one.bucket == group or group == ALL_SCENARIOS]


def _compute_values(episodes: Sequence[ScenarioResult], metrics: Sequence[ScalarMetric]) -> list[CellValue]:
    driven = [one for one in episodes if one.status == "ok"]
    close = [one.min_ttc for one in driven if one.min_ttc is not None]
    means: Mapping[str, float | None] = compute_scalar_means(episodes)
    return [
        compute_mean_of_known(one.time_ratio for one in episodes),
        100 * len(close) / len(driven) if driven else None,
        compute_mean_of_known(close),
        *(means.get(metric.name) for metric in metrics),
    ]
