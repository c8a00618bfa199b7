"""From scenarios to buckets, both overall means, and the paper's category figure (protocol 8.4, 8.5)."""

from collections.abc import Callable, Iterable, Sequence

from mdrive_sumo.scoring.results import BucketResult, Means, Overall, Results, RunInfo, ScenarioResult
from mdrive_sumo.scoring.score_mode import mean


def summarise(run: RunInfo, scenarios: Sequence[ScenarioResult]) -> Results:
    """The whole result of a run; raises ValueError without any scenario: a mean of nothing is no number."""
    return Results(
        run=run,
        overall=overall(scenarios),
        buckets=buckets(scenarios),
        void=sum(scenario.status == "void" for scenario in scenarios),
        scenarios=tuple(scenarios),
    )


def overall(scenarios: Sequence[ScenarioResult]) -> Overall:
    """Both means: over the buckets, as the paper's numbers are made, and over the scenarios (K2)."""
    return Overall(bucket_mean=means(buckets(scenarios).values()), scenario_mean=means(scenarios))


def buckets(scenarios: Sequence[ScenarioResult]) -> dict[str, BucketResult]:
    """Means over the scenarios of each bucket, void ones as DS 0; buckets in the order of their names."""
    return grouped_means(scenarios, lambda scenario: scenario.bucket)


def categories(scenarios: Sequence[ScenarioResult]) -> dict[str, BucketResult]:
    """As `buckets`, by category."""
    return grouped_means(scenarios, lambda scenario: scenario.category)


def means(scored: Iterable[Means]) -> Means:
    """Unweighted mean of each number; raises ValueError if there is nothing to take it of."""
    rows = tuple(scored)
    if not rows:
        raise ValueError("expected at least one scenario to take a mean of, found none")
    return Means(
        ds=mean(row.ds for row in rows),
        sr=mean(row.sr for row in rows),
        rc=mean(row.rc for row in rows),
        ip=mean(row.ip for row in rows),
    )


def harmonic(scored: Means) -> float:
    """The category figure H = 2 DS SR / (DS + SR) [%], of means; 0 if both are 0 (paper, fig. 5)."""
    return 2 * scored.ds * scored.sr / (scored.ds + scored.sr) if scored.ds + scored.sr else 0.0


def grouped_means(
    scenarios: Sequence[ScenarioResult], group_of: Callable[[ScenarioResult], str]
) -> dict[str, BucketResult]:
    """Means over the scenarios of each group, in the order of the groups' names."""
    groups: dict[str, list[ScenarioResult]] = {}
    for scenario in scenarios:
        groups.setdefault(group_of(scenario), []).append(scenario)
    return {
        name: BucketResult(scenarios=len(found), **means(found).model_dump()) for name, found in sorted(groups.items())
    }
