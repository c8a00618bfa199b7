"""Compare two runs scenario by scenario."""

from collections import defaultdict
from pathlib import Path

from mdrive_sumo.api.run import Run, load_run
from mdrive_sumo.runs.compare import RunComparison
from mdrive_sumo.runs.compare import compare as compare_results
from mdrive_sumo.scoring import Results, ScenarioResult
from mdrive_sumo.scoring.summary import compute_means


def compare(run: Run | str | Path, other: Run | str | Path) -> RunComparison:
    """Return the paired differences `other` minus `run`, with 95 % bootstrap intervals over the scenarios.

    Of several seeds the mean score of each scenario is compared; scenarios that are void with any seed are left out.
    Raises InputError for runs with different score modes or without a scenario in common.
    """
    first, second = (one if isinstance(one, Run) else load_run(one) for one in (run, other))
    return compare_results(_average_seeds(first), _average_seeds(second))


def _average_seeds(run: Run) -> Results:
    """Return results whose scenarios have the mean scores over the seeds."""
    if len(run.results) == 1:
        return run.results[0]
    by_id: defaultdict[str, list[ScenarioResult]] = defaultdict(list)
    for result in run.scores:
        by_id[result.id].append(result)
    return run.results[0].model_copy(update={"scenarios": tuple(map(_average, by_id.values()))})


def _average(results: list[ScenarioResult]) -> ScenarioResult:
    if void := next((result for result in results if result.status == "void"), None):
        return void
    return results[0].model_copy(update=compute_means(results).model_dump())
