"""check_seed_runs: runs of one agent that are put together differ in their seed alone."""

from collections.abc import Sequence

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scoring import Results


def check_seed_runs(runs: Sequence[Results]) -> None:
    """Raise InputError unless the runs differ in their seed alone and drove the same scenarios."""
    first = runs[0]
    seeds = [results.run.seed for results in runs]
    if len(set(seeds)) < len(seeds):
        raise InputError(f"agent {first.run.agent}: expected one run a seed, found the seeds {sorted(seeds)}")
    for results in runs[1:]:
        for name in sorted({*type(first.run).model_fields} - {"seed", "command"}):
            ours, theirs = getattr(first.run, name), getattr(results.run, name)
            if ours != theirs:
                raise InputError(f"agent {first.run.agent}: expected runs with one {name}, found {ours} and {theirs}")
        if {one.id for one in results.scenarios} != {one.id for one in first.scenarios}:
            raise InputError(f"agent {first.run.agent}: expected runs of the same scenarios, found others")
