"""Show an agent recorded drives: what `mdrive-sumo eval-open` does, as a function."""

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Unpack

from mdrive_sumo.api.evaluation import choose_worker_count, evaluate_with_progress
from mdrive_sumo.api.run import Run
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.setting import check_arguments
from mdrive_sumo.episode.episode_options import EpisodeArguments, EpisodeOptions
from mdrive_sumo.open_loop import REFERENCE_AGENT, OpenLoopResults, OpenLoopScenario, find_reference, prepare_open_loop
from mdrive_sumo.open_loop import evaluate_open as show_recordings
from mdrive_sumo.runs.agent_spec import AgentFactory, AgentSpec, parse_agent_limits
from mdrive_sumo.runs.prepared_run import prepare
from mdrive_sumo.runs.run_config import ConfigValue, RunConfig


def evaluate_open(
    agent: str | AgentFactory = "single",
    reference: str | Path | Run = REFERENCE_AGENT,
    *,
    suite: str | None = None,
    scenario: str = "*",
    seed: int | None = None,
    agent_config: Mapping[str, ConfigValue] | None = None,
    agent_limits: Mapping[str, float] | str = "",
    workers: int | None = None,
    out: str | Path | None = None,
    fresh: bool = False,
    sandbox: bool = False,
    progress: bool = True,
    **options: Unpack[EpisodeArguments],
) -> OpenLoopResults:
    """Compare an agent's plans and detections with recorded drives, without driving, and return the results.

    agent: as for `evaluate`. reference: "omniscient", which is driven first; "log", for suites that `convert` made of
    logs; a finished run of one folder, or that folder. suite: its name or folder; by default InterDrive, or the run's.
    scenario: a glob over ids and categories. seed: of the reference; by default 0, or all of the run.
    out: folder of journal and `open_loop.json`, by default one below `runs/`; `fresh` drops what it holds.
    The other arguments are those of `evaluate`, all of them options of `mdrive-sumo eval-open`.

    Raises InputError, and WorldError if a worker dies twice over one recording.
    """
    check_arguments(evaluate_open, options, EpisodeOptions)
    count = choose_worker_count(workers)

    def drive(config: RunConfig) -> Path:
        run = prepare(replace(config, workers=count))
        evaluate_with_progress(run, progress)
        return run.folder

    recorded = find_reference(_find_name(reference), drive, suite=suite, pattern=scenario, seed=seed)
    spec, chosen = AgentSpec(agent, agent_config or {}), EpisodeOptions.parse(**options)
    spec = spec.with_limits(parse_agent_limits(agent_limits)) if agent_limits else spec
    folder = None if out is None else Path(out)
    run = prepare_open_loop(recorded, spec, chosen, folder, count, sandbox=sandbox)

    def report(done: int, total: int, result: OpenLoopScenario) -> None:
        if progress:
            print(f"{done}/{total} {result.id}", file=sys.stderr)  # noqa: T201 (a display)

    return show_recordings(run, report, fresh=fresh)


def _find_name(reference: str | Path | Run) -> str:
    if not isinstance(reference, Run):
        return str(reference)
    if len(reference.folders) != 1:
        raise InputError(f"reference: expected a run of one folder, found {len(reference.folders)}")
    return str(reference.folders[0])
