"""Write a take as a run folder of one episode, on which all commands for runs work."""

from collections.abc import Sequence

from mdrive_sumo.contract.human_options import HUMAN
from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.clock import IDEAL
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.episode import EpisodeRecord, save_episode
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.episode_job import score_job_episode
from mdrive_sumo.runs.evaluate import RESULTS_FILE, report_write_errors
from mdrive_sumo.runs.journal import open_journal
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare_with_suite
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.scenario.suite import Suite, load_suite
from mdrive_sumo.scoring import ScenarioResult, save_results, summarize_run


def make_human_spec(
    substitutes: Sequence[str] = ("sharing",), v2x: str = "sharing", device: str = "unknown", latency_ms: float = 0.0
) -> AgentSpec:
    """Return the agent of a take.

    substitutes: built-in agents that may drive a CAV. v2x: what the car of a person sends by itself, `sharing` (CAMs
    and CPMs) or `off`. device: of the input. latency_ms: median time from an input to its tick.
    """
    options = {"substitutes": ",".join(substitutes), "v2x": v2x, "device": device, "latency_ms": latency_ms}
    return AgentSpec(HUMAN, options)


def prepare_take(config: RunConfig, suite: Suite | None = None) -> PreparedRun:
    """Return the run of a take: one scenario, one seed, the agent of `make_human_spec`, and the folder `config.out`.

    suite: that of the configuration, if it is loaded already. Raises InputError for anything else.
    """
    if config.agent.agent != HUMAN or config.others is not None:
        raise InputError(f"take: expected the agent {HUMAN} and no others, found {config.agent.name}")
    if config.options.clock != IDEAL:
        raise InputError(
            f"take: expected the agent clock ideal, found {config.options.clock.text}: people take their own time"
        )
    if config.out is None or config.has_many_seeds or not config.record:
        raise InputError("take: expected a folder, one seed and a recording")
    run = prepare_with_suite(config, suite or load_suite(config.suite), is_take=True)
    if len(run.scenarios) != 1:
        raise InputError(f"take: expected one scenario, found {len(run.scenarios)} of {config.scenario!r:.60}")
    return run


def write_take(run: PreparedRun, record: EpisodeRecord) -> ScenarioResult:
    """Score the episode of a take, write its run folder, and return the score. run: of `prepare_take`.

    The recording comes first and is renamed into place, then a line of the journal, then the results: whatever is cut
    off, what was written before stays sound. Raises InputError, also for a full disk.
    """
    (scenario,) = run.scenarios
    key = scenario.id, run.config.seed
    job = run.make_job(scenario)
    path = run.find_recording(key)
    about = {"run": run.info.model_dump(mode="json"), "episodes": 1}
    with open_journal(run.folder, run.fingerprint, fresh=run.config.fresh, about=about) as journal:
        with report_write_errors(run.folder):
            run.make_folders()
            (run.folder / RESULTS_FILE).unlink(missing_ok=True)
            save_episode(record, path)
        result = run.apply_reference_times(scenario, score_job_episode(job, record))
        journal.add_result(result.model_dump(mode="json"), compute_file_checksum(path))
        with report_write_errors(run.folder / RESULTS_FILE):
            save_results(summarize_run(run.info, [result]), run.folder / RESULTS_FILE)
    return result
