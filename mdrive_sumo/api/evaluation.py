"""Drive a suite with an agent: what `mdrive-sumo eval` does, as a function."""

import sys
from collections.abc import Callable, Mapping
from inspect import Parameter, Signature, signature
from typing import Any, Unpack, cast, get_type_hints

from mdrive_sumo.api.run import Run
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.setting import Setting, check_arguments, list_settings
from mdrive_sumo.report.progress import ProgressDisplay
from mdrive_sumo.report.run_report import save_run_report
from mdrive_sumo.runs.agent_spec import AgentFactory
from mdrive_sumo.runs.evaluate import EpisodeExecutor, Progress, start_workers
from mdrive_sumo.runs.evaluate import evaluate as run_jobs
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare
from mdrive_sumo.runs.process_pool import count_available_cores
from mdrive_sumo.runs.run_config import RunArguments, RunConfig
from mdrive_sumo.scenario.packaged_suites import name_packaged_suite
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.scoring import Results


def evaluate(
    suite: str | Suite = "interdrive",
    agent: str | AgentFactory = "idm",
    *,
    progress: bool = True,
    **settings: Unpack[RunArguments],
) -> Run:
    """Drive every scenario of a suite in worker processes, score it, and return the run.

    suite: a suite (also a part of one, such as `suite["i1*"]`), its name or its folder. scenario: a glob over ids and
    categories. agent: a built-in name, a class, `module:Class`, `path.py:Class`, `carla:path.py`.
    agent_limits: seconds that a third-party agent may take, such as {"start": 600, "tick": 30, "episode": 7200}.
    others: the agent of the CAVs that are not under test; `agent` then drives one CAV of each scenario, drawn by the
    seed, or the percentage of them that `penetration` says (without `others`, the rest drives as `single`).
    score_mode: by default that of the suite, `mdrive` or `hard` (docs/scoring.md).
    seeds: a number of seeds (3 means 0, 1 and 2) or the seeds themselves. workers: processes, by
    default one per core. scheduler: address of a Dask scheduler whose workers drive instead. pace_ms: time from the
    requests of a tick to those of the next one, whatever the agents take [ms]; it changes no result, 0: none.
    record: whether to keep recordings, without which there is no replay. record_features: whether they have the content
    of `feature` messages. record_cameras: whether to keep the colour images of the agent's cameras for replays.
    out: the run folder, which holds all seeds; by default a folder below `runs/` that the arguments determine. A folder
    that holds the same run, finished or interrupted, is continued; `fresh` drops it.
    sandbox: whether an agent of a file runs in boxes that hide the suite; otherwise results are labelled `unsandboxed`.
    fail_fast: whether to stop at the first failure of an agent and raise AgentFailure.
    progress: whether to print a line per scenario on standard error. options: `comm` (a preset or CommSettings),
    `agent_clock`, `actors`, `friction`, `ids`, `sensing`. They and the other arguments are the options of
    `mdrive-sumo eval`.

    Raises InputError, also if the folder holds another run.
    """
    check_arguments(evaluate, settings, RunConfig)
    name, settings["scenario"] = _locate(suite, _SETTINGS["scenario"].parse(settings.get("scenario", "*")))
    settings["workers"] = choose_worker_count(settings.get("workers"))
    config = RunConfig.parse(name, agent, **settings)
    with start_workers(config) as executor:
        run = prepare(config)
        return Run((run.folder,), (evaluate_with_progress(run, progress, executor),))


_SETTINGS: Mapping[str, Setting] = {one.key: one for one in list_settings(RunConfig)}


def choose_worker_count(workers: int | None) -> int:
    """Return the number of worker processes; None: one per core. Raises InputError."""
    return count_available_cores() if workers is None else _SETTINGS["workers"].parse(workers)


def _list_arguments(function: Callable[..., Any]) -> Signature:
    """Return the signature of a function that takes `**settings` with each of them, as `help` and notebooks show it."""
    own = [one for one in signature(function).parameters.values() if one.kind is not Parameter.VAR_KEYWORD]
    types, named = get_type_hints(RunArguments), {one.name for one in own}
    more = [
        Parameter(
            one.key,
            Parameter.KEYWORD_ONLY,
            default=None if one.key == "workers" else one.typed_default,
            annotation=types.get(one.key, one.kind),
        )
        for one in _SETTINGS.values()
        if one.key not in named
    ]
    return Signature([*own, *more], return_annotation=Run)


vars(evaluate)["__signature__"] = _list_arguments(evaluate)


def evaluate_run(run: PreparedRun, progress: Progress, executor: EpisodeExecutor | None = None) -> Results:
    """Drive what a prepared run lacks, write `results.json` and `report.md`, and return the results.

    executor: of `start_workers`. Raises InputError and KeyboardInterrupt; the journal then keeps every finished
    scenario.
    """
    results = run_jobs(run, progress, executor)
    save_run_report(run.folder, results)
    return results


def evaluate_with_progress(run: PreparedRun, is_shown: bool, executor: EpisodeExecutor | None = None) -> Results:
    """As `evaluate_run`, with a line for each scenario on standard error if it is shown."""
    display = ProgressDisplay(sys.stderr if is_shown else None)
    try:
        return evaluate_run(run, display, executor)
    finally:
        display.close()


def _locate(suite: str | Suite, scenario: str) -> tuple[str, str]:
    """Return the name or folder of a suite, and globs of the scenarios to drive. Raises InputError."""
    if isinstance(suite, str):
        return suite, scenario
    if not isinstance(cast(object, suite), Suite):
        raise InputError(f"suite: expected a suite, its name or its folder, found {suite!r:.40}")
    name = name_packaged_suite(suite.folder) or str(suite.folder)
    stored = load_suite(name)
    stored_by_id = {one.id: one for one in stored}
    changed = [one.id for one in suite if stored_by_id.get(one.id) != one]
    if changed:
        raise InputError(
            f"suite {suite.label}: expected scenarios as they are in {suite.folder}, found another {changed[0]!r};"
            " save_suite() writes it"
        )
    chosen = suite.select(scenario)
    return name, scenario if len(suite) == len(stored) else ",".join(one.id for one in chosen)
