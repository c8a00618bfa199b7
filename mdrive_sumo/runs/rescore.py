"""Score the recordings of a run again, in any score mode, without a simulation."""

from dataclasses import replace
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.runs.episode_job import rescore
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.recording_check import check_recordings
from mdrive_sumo.runs.stored_run import StoredRun
from mdrive_sumo.scoring import Results, ScenarioResult, ScoreMode, save_results, summarize_run


def rescore_run(stored: StoredRun, mode: ScoreMode) -> Results:
    """Return the results in another score mode; void scenarios stay void.

    Raises InputError, also for a recording that is not the one which the journal notes.
    """
    run, results = stored.run, stored.results
    if not run.config.record:
        raise InputError(f"{run.folder}: expected a run with recordings, found one made with --no-record")
    recorded = [result.key for result in results.scenarios if result.status != "void"]
    check_recordings(run, recorded, stored.journal.recordings)
    scenarios = {scenario.id: scenario for scenario in run.scenarios}

    def rescore_result(result: ScenarioResult) -> ScenarioResult:
        if result.status == "void":
            return run.apply_reference_times(scenarios[result.id], result)
        return rescore(replace(run.make_job(scenarios[result.id], result.seed), score_mode=mode))

    info = results.run.model_copy(update={"score_mode": str(mode)})
    return summarize_run(info, [rescore_result(result) for result in results.scenarios])


def rescored_path(folder: Path, mode: ScoreMode) -> Path:
    """Return the path of the results that `rescore` writes in a score mode."""
    return folder / f"results-{mode}.json"


def save_rescored(run: PreparedRun, results: Results) -> Path:
    """Write RUN/results-MODE.json beside the run's own results and return its path. Raises InputError."""
    path = rescored_path(run.folder, ScoreMode(results.run.score_mode))
    with report_write_errors(path):
        save_results(results, path)
    return path
