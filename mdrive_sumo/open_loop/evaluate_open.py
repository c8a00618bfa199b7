"""`evaluate_open`: show an agent all recordings of a run in worker processes; a journal keeps every finished one."""

from collections.abc import Callable, Generator, Sequence

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.open_loop.open_loop_job import run_open_loop_job
from mdrive_sumo.open_loop.open_loop_run import OpenLoopRun
from mdrive_sumo.open_loop.results import OpenLoopResults, OpenLoopScenario, summarize_open_loop
from mdrive_sumo.runs.evaluate import TRIES, report_write_errors
from mdrive_sumo.runs.executor import run_jobs
from mdrive_sumo.runs.journal import JOURNAL_FILE, Journal, open_journal
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.runs.process_pool import FailureKind, WorkerFailure
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.scoring.results import EpisodeKey

OPEN_LOOP_FILE = "open_loop.json"
Report = Callable[[int, int, OpenLoopScenario], None]
"""Receives the number of finished recordings, their total and the newest result."""


def evaluate_open(run: OpenLoopRun, report: Report, *, fresh: bool = False) -> OpenLoopResults:
    """Show the recordings that the journal does not hold yet, write `open_loop.json`, and return the results.

    Raises InputError, WorldError if a worker dies twice over one recording, and KeyboardInterrupt; the journal then
    keeps every finished recording.
    """
    with open_journal(run.folder, run.fingerprint, fresh=fresh) as journal:
        found = _load_kept_results(run, journal)
        todo = [key for key in run.episodes if key not in found]
        with report_write_errors(run.folder):
            for key in () if run.agent.is_builtin else todo:
                run.find_logs(key).mkdir(parents=True, exist_ok=True)
        for result in _show(run, todo, journal):
            journal.add_result(result.model_dump(mode="json"))
            found[result.key] = result
            report(len(found), len(run.episodes), result)
        whole = summarize_open_loop(run.info, [found[key] for key in run.episodes])
        path = run.folder / OPEN_LOOP_FILE
        with report_write_errors(path):
            path.write_text(whole.model_dump_json(indent=1) + "\n", encoding="utf-8")
    return whole


def _load_kept_results(run: OpenLoopRun, journal: Journal) -> dict[EpisodeKey, OpenLoopScenario]:
    place = run.folder / JOURNAL_FILE
    try:
        kept = {entry.key: entry for entry in map(OpenLoopScenario.model_validate, journal.results)}
    except ValidationError as error:
        raise InputError(f"{place}: {describe_first_error(error)}; --fresh starts anew") from None
    if foreign := sorted({*kept} - {*run.episodes}):
        raise InputError(f"{place}: expected scenarios of this run, found {foreign[0]}; --fresh starts anew")
    return kept


def _show(run: OpenLoopRun, todo: Sequence[EpisodeKey], journal: Journal) -> Generator[OpenLoopScenario]:
    jobs = [run.make_job(key) for key in todo]
    if not jobs:
        return
    with make_executor(run_open_loop_job, min(run.workers, len(jobs)), run.reference.limit_s()) as executor:
        for tries_left in reversed(range(TRIES)):
            failed = jobs[:0]
            for job, outcome in run_jobs(executor, jobs):
                if not isinstance(outcome, WorkerFailure):
                    yield outcome
                    continue
                if outcome.kind is FailureKind.INPUT:
                    raise InputError(outcome.reason)
                name = job.episode_job.scenario
                journal.add_failure(name, outcome.reason)
                if not tries_left:
                    raise WorldError(f"{name}: {outcome.reason}; the same command tries again")
                failed.append(job)
            jobs = failed
