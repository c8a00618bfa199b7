"""From scenarios to buckets, both overall means, and the paper's category figure (protocol 8.4, 8.5)."""

from collections.abc import Callable, Iterable, Sequence

from mdrive_sumo.scoring.results import BucketResult, Means, Overall, Results, RunInfo, ScenarioResult
from mdrive_sumo.scoring.score_mode import compute_mean


def summarize_run(run: RunInfo, scenarios: Sequence[ScenarioResult]) -> Results:
    """The whole result of a run; raises ValueError without any scenario: a mean of nothing is no number."""
    return Results(
        run=run,
        overall=compute_overall(scenarios),
        buckets=compute_bucket_means(scenarios),
        void=sum(scenario.status == "void" for scenario in scenarios),
        scenarios=tuple(scenarios),
    )


def compute_overall(scenarios: Sequence[ScenarioResult]) -> Overall:
    """Both means: over the buckets, as the paper's numbers are made, and over the scenarios (K2)."""
    return Overall(
        bucket_mean=compute_means(compute_bucket_means(scenarios).values()), scenario_mean=compute_means(scenarios)
    )


def compute_bucket_means(scenarios: Sequence[ScenarioResult]) -> dict[str, BucketResult]:
    """Means over the scenarios of each bucket, void ones as DS 0; buckets in the order of their names."""
    return compute_group_means(scenarios, lambda scenario: scenario.bucket)


def compute_category_means(scenarios: Sequence[ScenarioResult]) -> dict[str, BucketResult]:
    """As `buckets`, by category."""
    return compute_group_means(scenarios, lambda scenario: scenario.category)


def compute_means(scored: Iterable[Means]) -> Means:
    """Unweighted mean of each number; raises ValueError if there is nothing to take it of."""
    rows = tuple(scored)
    if not rows:
        raise ValueError("expected at least one scenario to take a mean of, found none")
    return Means(
        ds=compute_mean(row.ds for row in rows),
        sr=compute_mean(row.sr for row in rows),
        rc=compute_mean(row.rc for row in rows),
        ip=compute_mean(row.ip for row in rows),
    )


def compute_harmonic_mean(scored: Means) -> float:
    """The category figure H = 2 DS SR / (DS + SR) [%], of means; 0 if both are 0 (paper, fig. 5)."""
    return 2 * scored.ds * scored.sr / (scored.ds + scored.sr) if scored.ds + scored.sr else 0.0


def compute_group_means(
    scenarios: Sequence[ScenarioResult], group_of: Callable[[ScenarioResult], str]
) -> dict[str, BucketResult]:
    """Means over the scenarios of each group, in the order of the groups' names."""
    groups: dict[str, list[ScenarioResult]] = {}
    for scenario in scenarios:
        groups.setdefault(group_of(scenario), []).append(scenario)
    return {
        name: BucketResult(scenarios=len(found), **compute_means(found).model_dump())
        for name, found in sorted(groups.items())
    }
