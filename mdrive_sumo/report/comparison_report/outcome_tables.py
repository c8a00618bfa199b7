"""How drives ended, and efficiency and comfort beside the score."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from mdrive_sumo.core.tables import CellValue, Column, Row, Table, make_row
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.published_results import order_buckets
from mdrive_sumo.report.result_tables import count_collisions_by_severity, count_infractions, count_outcomes
from mdrive_sumo.scoring import Results, ScenarioResult
from mdrive_sumo.scoring.metrics import ScalarMetric, list_scalar_metrics
from mdrive_sumo.scoring.summary import compute_mean_of_known, compute_scalar_means

PER_DRIVES = 100
"""Infractions are counted per so many drives of a CAV."""
OUTCOME_NOTE = "Percent of the drives of all CAVs in all episodes; void episodes have none and are counted apart."
INFRACTION_NOTE = (
    f"Infractions that cost score, per {PER_DRIVES} drives of a CAV. Impact speeds: relative speed of a collision in"
    " the tick before the contact."
)
SEVERITY_GROUP = "impact"
ALL_SCENARIOS = "all scenarios"
SCALAR_NOTE = (
    "No score depends on these, and they are not ranked. Means over the episodes in which each is defined. Time ratio:"
    " time needed divided by that of omniscient, where every CAV arrives. Close calls: percent of the episodes whose"
    " time to contact falls below 1.8 s, and the mean of its minimum in these. Minimum PET: least time from when a CAV"
    " or another road user leaves a place until the other takes it, at most 5 s. Comfort: share of time within nuPlan's"
    " bounds. Messages: payload that all stations send in a second."
)
MIN_TTC = "min_ttc"


def count_drives(results: Results) -> int:
    """Return the number of CAVs, summed over all episodes that are not void."""
    return sum(len(scenario.egos) for scenario in results.scenarios)


def build_outcome_table(agents: Sequence[ComparedAgent], name: str = "outcomes") -> Table:
    """Return how the drives ended, in percent."""
    return _build_share_table(agents, count_outcomes, name, "Outcomes", OUTCOME_NOTE, with_void=True)


def build_infraction_table(agents: Sequence[ComparedAgent], name: str = "infractions") -> Table:
    """Return the infractions by kind, and the collisions by impact speed, per 100 drives."""

    def count(results: Results) -> Mapping[str, int]:
        severities = count_collisions_by_severity(results)
        return {**count_infractions(results), **{f"{SEVERITY_GROUP}: {kind}": n for kind, n in severities.items()}}

    return _build_share_table(agents, count, name, "Infractions", INFRACTION_NOTE, with_void=False)


def _build_share_table(
    agents: Sequence[ComparedAgent],
    count: Callable[[Results], Mapping[str, int]],
    name: str,
    title: str,
    note: str,
    *,
    with_void: bool,
) -> Table:
    counts = [Counter(count(agent.results)) for agent in agents]
    kinds = _order_kinds(counts)
    columns = [Column("agent", "Agent"), Column("drives", "drives", decimals=0)]
    columns += [Column(kind, _shorten(kind), _find_group(kind)) for kind in kinds]
    columns += [Column("void", "void episodes", decimals=0)] if with_void else []
    rows = [
        make_row(
            (
                agent.name,
                float(drives := count_drives(agent.results)),
                *(PER_DRIVES * count[kind] / drives if drives else None for kind in kinds),
                *((float(agent.results.void),) if with_void else ()),
            ),
            agent.section,
        )
        for agent, count in zip(agents, counts, strict=True)
    ]
    empty = "" if kinds else " There were none."
    return Table(name, title, tuple(columns), tuple(rows), note + empty)


def _order_kinds(counts: Sequence[Counter[str]]) -> list[str]:
    """Return all kinds, the most frequent first, severities last in their own order."""
    total: Counter[str] = sum(counts, Counter())
    severities = list(dict.fromkeys(kind for count in counts for kind in count if _find_group(kind)))
    others = sorted((kind for kind in total if not _find_group(kind)), key=lambda kind: (-total[kind], kind))
    return [*others, *severities]


def _find_group(kind: str) -> str:
    return "impact speed" if kind.startswith(f"{SEVERITY_GROUP}: ") else ""


def _shorten(kind: str) -> str:
    return kind.removeprefix(f"{SEVERITY_GROUP}: ")


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
    buckets = order_buckets(agents[0].results.buckets)
    for group in (*buckets, ALL_SCENARIOS) if len(buckets) > 1 else buckets:
        for agent in agents:
            drives = [drive for drive in agent.results.scenarios if group in (drive.bucket, ALL_SCENARIOS)]
            rows.append(make_row((agent.name, *_compute_values(drives, metrics)), group))
    return Table(name, "Efficiency and comfort", columns, tuple(rows), SCALAR_NOTE)


def _compute_values(episodes: Sequence[ScenarioResult], metrics: Sequence[ScalarMetric]) -> list[CellValue]:
    driven = [result for result in episodes if result.status == "ok"]
    close = [result.min_ttc for result in driven if result.min_ttc is not None]
    means: Mapping[str, float | None] = compute_scalar_means(episodes)
    return [
        compute_mean_of_known(result.time_ratio for result in episodes),
        100 * len(close) / len(driven) if driven else None,
        compute_mean_of_known(close),
        *(means.get(metric.name) for metric in metrics),
    ]
