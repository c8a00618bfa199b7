"""Drive a suite with an agent: what `mdrive-sumo eval` does, as a function."""

import sys
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Unpack, cast

from mdrive_sumo.api.run import Run
from mdrive_sumo.api.scenario_source import read_seed
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.loop.episode_config import EpisodeArguments, EpisodeOptions
from mdrive_sumo.report.progress import ProgressDisplay
from mdrive_sumo.report.run_report import save_run_report
from mdrive_sumo.runs.agent_limits import parse_agent_limits
from mdrive_sumo.runs.agent_spec import AgentFactory, AgentSpec
from mdrive_sumo.runs.evaluate import Progress
from mdrive_sumo.runs.evaluate import evaluate as run_jobs
from mdrive_sumo.runs.other_agents import parse_other_agents
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare
from mdrive_sumo.runs.process_pool import count_available_cores
from mdrive_sumo.runs.run_config import ConfigValue, RunConfig, check_seeds
from mdrive_sumo.scenario.suite import Suite, list_packaged_suites, load_suite
from mdrive_sumo.scoring import Results
from mdrive_sumo.scoring.score_mode import parse_score_mode


def evaluate(
    suite: str | Suite = "interdrive",
    agent: str | AgentFactory = "idm",
    *,
    scenario: str = "*",
    agent_config: Mapping[str, ConfigValue] | None = None,
    agent_limits: Mapping[str, float] | str = "",
    others: str | None = None,
    penetration: int | None = None,
    seeds: int | Iterable[int] = 1,
    score_mode: str | None = None,
    workers: int | None = None,
    scheduler: str = "",
    pace_ms: float = 0.0,
    record: bool = True,
    record_cameras: bool = False,
    out: str | Path | None = None,
    fresh: bool = False,
    sandbox: bool = False,
    fail_fast: bool = False,
    progress: bool = True,
    **options: Unpack[EpisodeArguments],
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
    record: whether to keep recordings, without which there is no replay. record_cameras: whether to keep the colour
    images of the agent's cameras for it.
    out: the run folder, which holds all seeds; by default a folder below `runs/` that the arguments determine. A folder
    that holds the same run, finished or interrupted, is continued; `fresh` drops it.
    sandbox: whether an agent of a file runs in boxes that hide the suite; otherwise results are labelled `unsandboxed`.
    fail_fast: whether to stop at the first failure of an agent and raise AgentFailure.
    progress: whether to print a line per scenario on standard error. options: `comm` (a preset or CommSettings),
    `agent_clock`, `actors`, `friction`, `ids`, `sensing`. They and the other arguments are the options of
    `mdrive-sumo eval`.

    Raises InputError, also if the folder holds another run.
    """
    name, pattern = _locate(suite, scenario)
    chosen = tuple(map(read_seed, seeds)) if isinstance(seeds, Iterable) else tuple(range(read_seed(seeds)))
    check_seeds(chosen)
    config = RunConfig(
        suite=name,
        scenario=pattern,
        agent=AgentSpec(agent, agent_config or {}),
        others=parse_other_agents(others, penetration),
        seed=chosen[0],
        more_seeds=chosen[1:],
        chosen_mode=parse_score_mode(score_mode) if score_mode else None,
        options=EpisodeOptions.parse(**options),
        workers=workers or count_available_cores(),
        scheduler=scheduler,
        pace_s=pace_ms / 1000,
        record=record,
        record_cameras=record_cameras,
        out=None if out is None else Path(out),
        fresh=fresh,
        sandbox=sandbox,
        fail_fast=fail_fast,
    )
    run = prepare(config.with_agent_limits(parse_agent_limits(agent_limits)) if agent_limits else config)
    return Run((run.folder,), (evaluate_with_progress(run, progress),))


def evaluate_run(run: PreparedRun, progress: Progress) -> Results:
    """Drive what a prepared run lacks, write `results.json` and `report.md`, and return the results.

    Raises InputError and KeyboardInterrupt; the journal then keeps every finished scenario.
    """
    results = run_jobs(run, progress)
    save_run_report(run.folder, results)
    return results


def evaluate_with_progress(run: PreparedRun, is_shown: bool) -> Results:
    """As `evaluate_run`, with a line for each scenario on standard error if it is shown."""
    display = ProgressDisplay(sys.stderr if is_shown else None)
    try:
        return evaluate_run(run, display)
    finally:
        display.close()


def _locate(suite: str | Suite, scenario: str) -> tuple[str, str]:
    """Return the name or folder of a suite, and globs of the scenarios to drive. Raises InputError."""
    if isinstance(suite, str):
        return suite, scenario
    if not isinstance(cast(object, suite), Suite):
        raise InputError(f"suite: expected a suite, its name or its folder, found {suite!r:.40}")
    name = suite.name if list_packaged_suites().get(suite.name) == suite.folder else str(suite.folder)
    stored = load_suite(name)
    known = {one.id: one for one in stored}
    changed = [one.id for one in suite if known.get(one.id) != one]
    if changed:
        raise InputError(
            f"suite {suite.name}: expected scenarios as they are in {suite.folder}, found another {changed[0]!r};"
            " save_suite() writes it"
        )
    chosen = suite.select(scenario)
    return name, scenario if len(suite) == len(stored) else ",".join(one.id for one in chosen)
