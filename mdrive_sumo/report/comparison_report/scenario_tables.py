"""Scores by scenario, their distribution, and scores by category: the paper's category figure as a table, and all."""

from collections.abc import Callable, Mapping, Sequence

from mdrive_sumo.core.tables import (
    BestValue,
    Cell,
    CellValue,
    Column,
    Row,
    Table,
    make_row,
)
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.comparison_report.replay_pages import list_replay_pages
from mdrive_sumo.report.published_results import order_buckets
from mdrive_sumo.runs.compare import average_seeds
from mdrive_sumo.scenario.categories import InteractivityLevel
from mdrive_sumo.scoring import (
    BucketResult,
    ScenarioResult,
    ScoreMode,
    compute_category_means,
    compute_harmonic_mean,
    compute_interdrive_means,
    compute_level_means,
)
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
HARMONIC_MEAN_NOTE = (
    "H = 2 DS SR / (DS + SR), the harmonic mean of the mean DS and the mean SR over the scenarios of a group, 0 if both"
    " are 0: what the paper's category figure shows (mdrive.tex, fig:mdrive_highlevel_subscore: harmonic mean between"
    " Driving Score and Success Rate). The paper does not say whether means are taken first; here they are."
)
LEVEL_NOTE = (
    "Levels: the paper's three interactivity levels of Interaction (mdrive.tex, fig:mdrive_representative_scenarios)."
)
GROUP_NOTE = (
    "IC, LM, LC: intersection crossing, lane merge, lane change, the groups in which CoLMDriver's code evaluates"
    " InterDrive."
)
GroupMeans = Mapping[str, BucketResult]
SCORES: Mapping[str, tuple[str, Callable[[BucketResult], float]]] = {
    "ds": ("DS", lambda means: means.ds),
    "sr": ("SR", lambda means: means.sr),
    "h": ("H", compute_harmonic_mean),
}
"""Scores of a category by the suffix of the table's name."""


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
        for scenario in sorted(names, key=lambda name: (sum(result_by_id[name].ds for result_by_id in means), name)):
            cells = [
                Cell(None if mean.status == "void" else getattr(mean, score), replay=pages.get(scenario))
                for mean, pages in zip((results[scenario] for results in means), replays, strict=True)
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


def compute_agent_levels(agent: ComparedAgent) -> GroupMeans:
    """Return the means of an agent by interactivity level, in the paper's order of levels."""
    means_by_level = compute_level_means(agent.results.scenarios)
    return {level: means_by_level[level] for level in InteractivityLevel if level in means_by_level}


def compute_agent_groups(agent: ComparedAgent) -> GroupMeans:
    """Return the means of an agent by InterDrive's groups."""
    return compute_interdrive_means(agent.results.scenarios, ScoreMode(agent.results.run.score_mode))


def build_level_table(agents: Sequence[ComparedAgent], name: str = "levels") -> Table | None:
    """Return DS, SR and H by interactivity level, which the category figure draws; None without such scenarios."""
    means = [compute_agent_levels(agent) for agent in agents]
    note = f"{HARMONIC_MEAN_NOTE} {LEVEL_NOTE}"
    return _build_group_table(agents, means, name, "Scores by interactivity level", note)


def build_interdrive_table(agents: Sequence[ComparedAgent], name: str = "interdrive_groups") -> Table | None:
    """Return DS, SR and H by InterDrive's groups; None without such scenarios."""
    means = [compute_agent_groups(agent) for agent in agents]
    return _build_group_table(agents, means, name, "Scores by InterDrive group", f"{HARMONIC_MEAN_NOTE} {GROUP_NOTE}")


def _build_group_table(
    agents: Sequence[ComparedAgent], means: Sequence[GroupMeans], name: str, title: str, note: str
) -> Table | None:
    if not means[0]:
        return None
    columns = [Column("agent", "Agent")]
    for group, group_means in means[0].items():
        heading = f"{group} ({group_means.scenarios})"
        columns += [
            Column(f"{group}_{key}", label, heading, best=BestValue.HIGHEST) for key, (label, _) in SCORES.items()
        ]
    rows = [
        make_row(
            (agent.name, *(compute(group) for group in group_means.values() for _, compute in SCORES.values())),
            agent.section,
            is_ranked=agent.is_ranked,
            rank_group=agent.rank_group,
        )
        for agent, group_means in zip(agents, means, strict=True)
    ]
    note = f"{note} In brackets: number of scenarios."
    return Table(name, title, tuple(columns), tuple(rows), note).mark_columns()


def build_category_table(agents: Sequence[ComparedAgent], score: str = "h", name: str = "") -> Table:
    """Return one score of every agent by category, a row for each category, the best three of each row marked.

    score: a key of `SCORES`.
    """
    label, compute = SCORES[score]
    columns = (
        Column("category", "Category"),
        Column("scenarios", "scenarios", decimals=0),
        *(
            Column(
                agent.name,
                agent.name,
                best=BestValue.HIGHEST if agent.is_ranked else BestValue.NONE,
                rank_group=agent.rank_group,
            )
            for agent in agents
        ),
    )
    rows: list[Row] = []
    for bucket, categories in list_categories(agents[0]).items():
        means = [
            compute_category_means([result for result in agent.results.scenarios if result.bucket == bucket])
            for agent in agents
        ]
        for category in categories:
            values: list[CellValue] = [compute(means_by_category[category]) for means_by_category in means]
            rows.append(make_row((category, float(means[0][category].scenarios), *values), bucket))
    what = "H = 2 DS SR / (DS + SR) of the mean DS and the mean SR" if score == "h" else f"Mean {label}"
    note = f"{what} over the scenarios of a category, in percent."
    return Table(name or f"categories_{score}", f"{label} by category", columns, tuple(rows), note).mark_rows()


def list_categories(agent: ComparedAgent) -> dict[str, tuple[str, ...]]:
    """Return the categories of each bucket, sorted by name, the buckets in the paper's order."""
    categories: dict[str, set[str]] = {}
    for scenario in agent.results.scenarios:
        categories.setdefault(scenario.bucket, set()).add(scenario.category)
    return {bucket: tuple(sorted(categories[bucket])) for bucket in order_buckets(categories)}
