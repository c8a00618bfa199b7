"""Options of commands over a stored run: which episode, where its suite is, whether its agent may run."""

import sys
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from mdrive_sumo.cli.setting_options import add_options, setting_option
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.scoring import Results

if TYPE_CHECKING:
    from mdrive_sumo.api.verification import Permission
    from mdrive_sumo.export.scored_recording import ScoredRecording

moved_suite_option = click.option("--suite", metavar="NAME|DIR", help="Where the run's suite is now, if it has moved.")


def find_one_scenario(suite: Suite, pattern: str) -> Scenario:
    """Return the only scenario whose id or category fits a glob. Raises InputError if none or several fit."""
    fitting = suite.select(pattern)
    if len(fitting) == 1:
        return fitting[0]
    raise InputError(
        f"suite {suite.name}: expected {pattern!r} to fit one scenario, found {len(fitting)}:"
        f" {', '.join(scenario.id for scenario in fitting[:4])}{' ...' if len(fitting) > 4 else ''}; an id names one"
    )


def choose_seed(results: Results, seed: int | None) -> int:
    """Return a seed of a run, the first if none is given. Raises InputError for a seed that the run does not have."""
    seeds = results.run.all_seeds
    if seed is None:
        return seeds[0]
    if seed not in seeds:
        raise InputError(f"--seed: expected one of the run's, {', '.join(map(str, seeds))}, found {seed}")
    return seed


def load_one_recording(folder: Path, pattern: str | None, seed: int | None, suite: str | None) -> "ScoredRecording":
    """Return the recording of the only scenario that fits. Raises InputError."""
    from mdrive_sumo.export.export_run import load_recordings, select_recorded
    from mdrive_sumo.runs.stored_run import load_stored_run

    stored = load_stored_run(folder, suite)
    chosen = choose_seed(stored.results, seed)
    results = select_recorded(stored, (stored.results.scenarios[0].id if pattern is None else pattern,))
    ids = list(dict.fromkeys(result.id for result in results))
    if len(ids) > 1:
        raise InputError(
            f"{folder}: expected {pattern!r} to fit one scenario, found {len(ids)}: {', '.join(ids[:4])}"
            f"{' ...' if len(ids) > 4 else ''}; an id names one"
        )
    of_seed = [result for result in results if result.seed == chosen]
    if not of_seed:
        raise InputError(f"{folder}: scenario {ids[0]}: expected a recorded episode of seed {chosen}, found a void one")
    return next(load_recordings(stored, of_seed))


def foreign_agent_options(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add `--trust-agent`, `--sandbox` and `--agent` to a command that executes a stored run."""
    return add_options(
        [
            click.option(
                "--trust-agent", is_flag=True, help="Run the agent's file that RUN names with your permissions."
            ),
            click.option(
                "--sandbox", is_flag=True, help="Run it in boxes, as a run made with `eval --sandbox` always is."
            ),
            click.option("--agent", metavar="PATH:CLASS", help="Where the run's agent is now, if it has moved."),
            setting_option("agent_limits"),
        ]
    )(function)


def read_permission(options: dict[str, Any]) -> "Permission":
    """Take the options out of a command's and return them. On a terminal the user is asked if none permits it."""
    from mdrive_sumo.api.verification import Permission  # only here: other commands execute nothing

    ask = click.confirm if sys.stdin.isatty() else None
    trusted, sandbox, place = (options.pop(name) for name in ("trust_agent", "sandbox", "agent"))
    return Permission(trusted, sandbox, place, ask, options.pop("agent_limits"))
