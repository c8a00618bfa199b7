"""`evaluate_open`: show an agent recorded drives in worker processes; a journal keeps every finished one."""

from collections.abc import Callable, Generator, Sequence
from contextlib import AbstractContextManager, nullcontext

from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError, WorldError
from mdrive_sumo.core.output_files import make_folder, write_text
from mdrive_sumo.open_loop.open_loop_job import OpenLoopJob, run_open_loop_job
from mdrive_sumo.open_loop.open_loop_run import OpenLoopRun
from mdrive_sumo.open_loop.results import OpenLoopResults, OpenLoopScenario, summarize_open_loop
from mdrive_sumo.runs.evaluate import report_write_errors, run_with_retries
from mdrive_sumo.runs.executor import Executor
from mdrive_sumo.runs.journal import JOURNAL_FILE, Journal, open_journal
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.runs.process_pool import WorkerFailure
from mdrive_sumo.scenario.scenario import describe_first_error
from mdrive_sumo.scoring.results import EpisodeKey

OPEN_LOOP_FILE = "open_loop.json"
Report = Callable[[int, int, OpenLoopScenario], None]
"""Receives the number of finished recordings, their total and the newest result."""


OpenLoopExecutor = Executor[OpenLoopJob, OpenLoopScenario]


def make_open_loop_executor(workers: int, limit_s: float) -> AbstractContextManager[OpenLoopExecutor]:
    """Return worker processes for several evaluations, so that none starts its own. limit_s: as of `OpenLoopRun`."""
    return make_executor(run_open_loop_job, workers, limit_s)


def evaluate_open(
    run: OpenLoopRun, report: Report, *, fresh: bool = False, executor: OpenLoopExecutor | None = None
) -> OpenLoopResults:
    """Show the recordings that the journal does not hold yet, write `open_loop.json`, and return the results.

    executor: of `make_open_loop_executor`; None: this evaluation starts and ends workers of its own.
    Raises InputError, WorldError if a worker dies twice over one recording, and KeyboardInterrupt; the journal then
    keeps every finished recording.
    """
    with open_journal(run.folder, run.fingerprint, fresh=fresh) as journal:
        kept = _load_kept_results(run, journal)
        todo = [key for key in run.episodes if key not in kept]
        with report_write_errors(run.folder):
            for key in () if run.agent.is_builtin else todo:
                make_folder(run.find_logs(key))
        for result in _show(run, todo, journal, executor):
            journal.add_result(result.model_dump(mode="json"))
            kept[result.key] = result
            report(len(kept), len(run.episodes), result)
        whole = summarize_open_loop(run.info, [kept[key] for key in run.episodes])
        path = run.folder / OPEN_LOOP_FILE
        with report_write_errors(path):
            write_text(path, whole.model_dump_json(indent=1) + "\n")
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


def _show(
    run: OpenLoopRun, todo: Sequence[EpisodeKey], journal: Journal, shared: OpenLoopExecutor | None
) -> Generator[OpenLoopScenario]:
    """Yield the result of every recording as it finishes."""
    jobs = [run.make_job(key) for key in todo]
    if not jobs:
        return

    def note_failure(job: OpenLoopJob, reason: str, is_last: bool) -> None:
        name = job.episode_job.scenario
        journal.add_failure(name, reason)
        if is_last:
            raise WorldError(f"{name}: {reason}; the same command tries again")

    own = make_open_loop_executor(min(run.workers, len(jobs)), run.limit_s())
    with nullcontext(shared) if shared else own as executor:
        for _, outcome in run_with_retries(executor, jobs, note_failure):
            if not isinstance(outcome, WorkerFailure):
                yield outcome
