"""Tables by category: the paper's category figure as a table, InterDrive's groups, and every category."""

from collections.abc import Callable, Mapping, Sequence

from mdrive_sumo.core.tables import (
    BestValue,
    CellValue,
    Column,
    Row,
    Table,
    make_row,
)
from mdrive_sumo.report.comparison_report.compared_agent import ComparedAgent
from mdrive_sumo.report.comparison_report.published_rows import order_buckets
from mdrive_sumo.scenario.categories import InteractivityLevel
from mdrive_sumo.scoring import (
    BucketResult,
    ScoreMode,
    compute_category_means,
    compute_harmonic_mean,
    compute_interdrive_means,
    compute_level_means,
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


def compute_agent_levels(agent: ComparedAgent) -> GroupMeans:
    """Return the means of an agent by interactivity level, in the paper's order of levels."""
    found = compute_level_means(agent.results.scenarios)
    return {level: found[level] for level in InteractivityLevel if level in found}


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
    for group, found in means[0].items():
        heading = f"{group} ({found.scenarios})"
        columns += [
            Column(f"{group}_{key}", label, heading, best=BestValue.HIGHEST) for key, (label, _) in SCORES.items()
        ]
    rows = [
        make_row(
            (agent.name, *(compute(group) for group in found.values() for _, compute in SCORES.values())),
            agent.section,
            is_ranked=agent.is_ranked,
            rank_group=agent.rank_group,
        )
        for agent, found in zip(agents, means, strict=True)
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
            compute_category_means([one for one in agent.results.scenarios if one.bucket == bucket]) for agent in agents
        ]
        for category in categories:
            values: list[CellValue] = [compute(found[category]) for found in means]
            rows.append(make_row((category, float(means[0][category].scenarios), *values), bucket))
    what = "H = 2 DS SR / (DS + SR) of the mean DS and the mean SR" if score == "h" else f"Mean {label}"
    note = f"{what} over the scenarios of a category, in percent."
    return Table(name or f"categories_{score}", f"{label} by category", columns, tuple(rows), note).mark_rows()


def list_categories(agent: ComparedAgent) -> dict[str, tuple[str, ...]]:
    """Return the categories of each bucket, sorted by name, the buckets in the paper's order."""
    found: dict[str, set[str]] = {}
    for scenario in agent.results.scenarios:
        found.setdefault(scenario.bucket, set()).add(scenario.category)
    return {bucket: tuple(sorted(found[bucket])) for bucket in order_buckets(found)}
