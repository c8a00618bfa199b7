"""Compare two runs scenario by scenario."""

from pathlib import Path

from mdrive_sumo.api.run import Run, load_run
from mdrive_sumo.runs.compare import RunComparison
from mdrive_sumo.runs.compare import compare as compare_results
from mdrive_sumo.scoring import Results


def compare(run: Run | str | Path, other: Run | str | Path) -> RunComparison:
    """Return the paired differences `other` minus `run`, with 95 % bootstrap intervals over the scenarios.

    Of several seeds the mean score of each scenario is compared; scenarios that are void with any seed are left out.
    Raises InputError for runs with different score modes or without a scenario in common.
    """
    first, second = (one if isinstance(one, Run) else load_run(one) for one in (run, other))
    return compare_results(_join(first), _join(second), (first.folders[0], second.folders[0]))


def _join(run: Run) -> Results:
    """Return the results of all folders of a run as one."""
    return run.results[0].model_copy(update={"scenarios": tuple(run.scores)})
