"""Means over buckets, categories and the run, and the paper's category figure (protocol 8.4, 8.5)."""

from collections.abc import Callable, Iterable, Sequence

from mdrive_sumo.contract import join_sensing_tracks
from mdrive_sumo.scoring.labels import derive_labels
from mdrive_sumo.scoring.results import BucketResult, Means, Overall, Results, RunInfo, ScenarioResult
from mdrive_sumo.scoring.roles import compute_roles
from mdrive_sumo.scoring.score_mode import compute_mean


def summarize_run(run: RunInfo, scenarios: Sequence[ScenarioResult]) -> Results:
    """Return the results of a run, with labels and track as its scenarios show. Raises ValueError without any."""
    return Results(
        run=run.model_copy(update=_derive_facts(run, scenarios)),
        overall=compute_overall(scenarios),
        buckets=compute_bucket_means(scenarios),
        void=sum(scenario.status == "void" for scenario in scenarios),
        scenarios=tuple(scenarios),
    )


def _derive_facts(run: RunInfo, scenarios: Sequence[ScenarioResult]) -> dict[str, object]:
    """Return what a run's description says of its scenarios: labels and sensing track."""
    tracks = (scenario.sensing_track for scenario in scenarios if scenario.status != "void")
    return {"labels": derive_labels(run.labels, scenarios), "sensing_track": join_sensing_tracks(tracks)}


def compute_overall(scenarios: Sequence[ScenarioResult]) -> Overall:
    """Return both means: over the buckets, as in the paper's tables, and over the scenarios (K2)."""
    return Overall(
        bucket_mean=compute_means(compute_bucket_means(scenarios).values()),
        scenario_mean=compute_means(scenarios),
        timed=count_timed(scenarios),
        scalars=compute_scalar_means(scenarios),
        roles=compute_roles(scenarios),
    )


def compute_scalar_means(scenarios: Sequence[ScenarioResult]) -> dict[str, float | None]:
    """Return the mean of each scalar metric but `min_ttc` over the scenarios in which it is defined.

    No driving score depends on them. The minimum TTC has no mean: it is undefined where nothing came close.
    """
    names = dict.fromkeys(name for scenario in scenarios for name in scenario.scalars)
    return {name: compute_mean_of_known(scenario.scalars.get(name) for scenario in scenarios) for name in names}


def count_timed(scenarios: Iterable[ScenarioResult]) -> int:
    """Return the number of scenarios that have a time ratio."""
    return sum(scenario.time_ratio is not None for scenario in scenarios)


def count_scenarios(results: Iterable[ScenarioResult]) -> int:
    """Return the number of different scenarios among episodes of any number of seeds."""
    return len({result.id for result in results})


def compute_bucket_means(scenarios: Sequence[ScenarioResult]) -> dict[str, BucketResult]:
    """Return means over the scenarios of each bucket, sorted by name; void scenarios count as DS 0."""
    return compute_group_means(scenarios, lambda scenario: scenario.bucket)


def compute_category_means(scenarios: Sequence[ScenarioResult]) -> dict[str, BucketResult]:
    """As `compute_bucket_means`, by category."""
    return compute_group_means(scenarios, lambda scenario: scenario.category)


def compute_means(scored: Iterable[Means]) -> Means:
    """Return the unweighted mean of each number: of efficient SR and time ratio over the rows that have one.

    Raises ValueError for an empty input.
    """
    rows = tuple(scored)
    if not rows:
        raise ValueError("expected at least one scenario to take a mean of, found none")
    return Means(
        ds=compute_mean(row.ds for row in rows),
        sr=compute_mean(row.sr for row in rows),
        rc=compute_mean(row.rc for row in rows),
        ip=compute_mean(row.ip for row in rows),
        efficient_sr=compute_mean_of_known(row.efficient_sr for row in rows),
        time_ratio=compute_mean_of_known(row.time_ratio for row in rows),
    )


def compute_mean_of_known(values: Iterable[float | None]) -> float | None:
    """Return the mean of the values that are not None; None if there are none."""
    defined = [value for value in values if value is not None]
    return compute_mean(defined) if defined else None


def compute_harmonic_mean(scored: Means) -> float:
    """Return the category figure H = 2 DS SR / (DS + SR) [%] of means; 0 if both are 0 (paper, fig. 5)."""
    return 2 * scored.ds * scored.sr / (scored.ds + scored.sr) if scored.ds + scored.sr else 0.0


def compute_group_means(
    scenarios: Sequence[ScenarioResult], group_of: Callable[[ScenarioResult], str]
) -> dict[str, BucketResult]:
    """Return means over the scenarios of each group, sorted by name."""
    groups: dict[str, list[ScenarioResult]] = {}
    for scenario in scenarios:
        groups.setdefault(group_of(scenario), []).append(scenario)
    return {
        name: BucketResult(
            scenarios=count_scenarios(members),
            timed=count_timed(members),
            scalars=compute_scalar_means(members),
            **compute_means(members).model_dump(),
        )
        for name, members in sorted(groups.items())
    }
