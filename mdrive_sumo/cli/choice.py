"""Find the scenarios that a user names on the command line."""

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.scoring import Results


def find_one_scenario(suite: Suite, pattern: str) -> Scenario:
    """Return the only scenario whose id or category fits a glob. Raises InputError if none or several fit."""
    found = suite.select(pattern)
    if len(found) == 1:
        return found[0]
    raise InputError(
        f"suite {suite.name}: expected {pattern!r} to fit one scenario, found {len(found)}:"
        f" {', '.join(scenario.id for scenario in found[:4])}{' ...' if len(found) > 4 else ''}; an id names one"
    )


def choose_seed(results: Results, seed: int | None) -> int:
    """Return a seed of a run, the first if none is given. Raises InputError for a seed that the run does not have."""
    seeds = results.run.all_seeds
    if seed is None:
        return seeds[0]
    if seed not in seeds:
        raise InputError(f"--seed: expected one of the run's, {', '.join(map(str, seeds))}, found {seed}")
    return seed
