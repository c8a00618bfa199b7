"""The two reference runs of captured cooperation: loaded from their default folders, or driven."""

from collections.abc import Callable
from dataclasses import replace

from mdrive_sumo.core.clock import IDEAL
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scoring import Results
from mdrive_sumo.scoring.captured_cooperation import CapturedCooperation, compute_captured_cooperation
from mdrive_sumo.study.study_runs import BEST
from mdrive_sumo.v2x.comm_settings import PRESETS

Evaluate = Callable[[PreparedRun], Results]


def make_reference_configs(config: RunConfig) -> tuple[RunConfig, RunConfig]:
    """Return the same agent with the channel off, and omniscient: suite, scenarios, seed and score mode of `config`.

    They have no `out`, so they lie where `eval` puts them by default: one reference serves many runs. `fresh` does
    not reach them.
    """
    own = replace(config, out=None, fresh=False)
    off = replace(own, options=replace(own.options, comm=PRESETS["off"]))
    best = replace(own, agent=AgentSpec(BEST), options=replace(own.options, comm=PRESETS["ideal"], clock=IDEAL))
    return off, best


def evaluate_captured_cooperation(results: Results, config: RunConfig, evaluate: Evaluate) -> CapturedCooperation:
    """Return the captured cooperation of a finished run; `evaluate` drives the references unless they are finished.

    Raises InputError, and what `evaluate` raises.
    """
    try:
        off, best = (evaluate(prepare(reference)) for reference in make_reference_configs(config))
    except InputError as error:
        problem, stale, _ = str(error).partition("; --fresh")
        mend = "; remove that folder to have it driven anew" if stale else ""
        raise InputError(f"reference for captured cooperation: {problem}{mend}") from None
    return compute_captured_cooperation(results, off, best)
