"""Scores by scenario: the matrix agents x scenarios, and the distribution of the driving score."""

from collections.abc import Mapping, Sequence

from mdrive_sumo.core.tables import Cell, Column, Row, Table, make_row
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.comparison_report.published_rows import order_buckets
from mdrive_sumo.report.comparison_report.replay_pages import list_replay_pages
from mdrive_sumo.runs.compare import average_seeds
from mdrive_sumo.scoring import ScenarioResult
from mdrive_sumo.scoring.score_mode import SUCCESS_DS

DS_CLASSES = (("below 20", 20.0), ("20 to 40", 40.0), ("40 to 60", 60.0), ("60 to 80", 80.0), ("80 to 100", SUCCESS_DS))
"""Classes of driving score by their upper bounds, which belong to the class above; what is beyond all is `FULL`."""
FULL = "100"
DISTRIBUTION_NOTE = (
    "Percent of the episodes with a driving score in each class. 100: above 99.95, the bound of success."
)
MATRIX_NOTE = (
    "Means over the seeds. The scenarios of a bucket in the order of their mean over all agents, the hardest first."
)


def build_distribution_table(agents: Sequence[ComparedAgent], name: str = "distribution") -> Table:
    """Return the share of episodes in each class of driving score; void episodes count as 0, as in all means."""
    labels = [*(label for label, _ in DS_CLASSES), FULL]
    rows = [
        make_row((agent.name, *compute_distribution(agent.results.scenarios).values()), agent.section)
        for agent in agents
    ]
    columns = (
        Column("agent", "Agent"),
        *(Column(label, label, "episodes [%] by DS", decimals=1) for label in labels),
    )
    return Table(name, "Distribution of the driving score", columns, tuple(rows), DISTRIBUTION_NOTE)


def compute_distribution(scenarios: Sequence[ScenarioResult]) -> Mapping[str, float]:
    """Return the share [%] of the episodes in each class of driving score."""
    labels = (*(label for label, _ in DS_CLASSES), FULL)
    counts = dict.fromkeys(labels, 0)
    for scenario in scenarios:
        counts[labels[find_ds_class(scenario.ds)]] += 1
    return {label: 100 * count / len(scenarios) for label, count in counts.items()}


def find_ds_class(score: float) -> int:
    """Return the number of the class of a driving score: 0 for the lowest."""
    return sum(score > bound if bound == SUCCESS_DS else score >= bound for _, bound in DS_CLASSES)


def build_scenario_table(agents: Sequence[ComparedAgent], score: str = "ds", name: str = "") -> Table:
    """Return a score of every agent in every scenario, in sections by bucket. score: "ds" or "sr"."""
    means = [average_seeds(agent.results.scenarios) for agent in agents]
    replays = [list_replay_pages(agent) for agent in agents]
    columns = (
        Column("scenario", "Scenario"),
        Column("category", "Category"),
        *(Column(agent.name, agent.name, decimals=1) for agent in agents),
    )
    first = means[0]
    rows: list[Row] = []
    for bucket in order_buckets({result.bucket for result in first.values()}):
        names = [name for name, result in first.items() if result.bucket == bucket]
        for scenario in sorted(names, key=lambda name: (sum(found[name].ds for found in means), name)):
            cells = [
                Cell(_find_score(found[scenario], score), replay=pages.get(scenario))
                for found, pages in zip(means, replays, strict=True)
            ]
            rows.append(make_row((scenario, first[scenario].category, *cells), bucket))
    return Table(
        name or f"scenarios_{score}",
        f"{score.upper()} by scenario",
        columns,
        tuple(rows),
        f"{MATRIX_NOTE} -: void.",
        is_shaded=True,
    )


def _find_score(result: ScenarioResult, score: str) -> float | None:
    return None if result.status == "void" else getattr(result, score)
