"""`evaluate`: drive the scenarios of a run in worker processes; a journal keeps every finished one."""

from collections.abc import Callable, Generator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import partial
from pathlib import Path
from typing import Protocol, TypeVar

from pydantic import ValidationError
from pydantic_core import PydanticSerializationError

from mdrive_sumo.core.checksum import compute_file_checksum
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.state import End, FailureReason
from mdrive_sumo.loop.agent_driver import AgentFailure
from mdrive_sumo.runs.episode_cost import estimate_cost
from mdrive_sumo.runs.episode_job import EpisodeJob, run_job
from mdrive_sumo.runs.executor import Executor, ReportRunning, run_jobs
from mdrive_sumo.runs.journal import JOURNAL_FILE, Journal, open_journal
from mdrive_sumo.runs.make_executor import make_executor
from mdrive_sumo.runs.prepared_run import PreparedRun, compute_job_limit_s
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure, describe_write_error
from mdrive_sumo.runs.recording_check import check_recordings
from mdrive_sumo.runs.result_transfer import TransferableResult, run_with_output_files, store_output_files
from mdrive_sumo.runs.run_config import RunConfig
from mdrive_sumo.runs.transcript import TRANSCRIPT_FILE, concatenate_transcripts
from mdrive_sumo.scenario.scenario import Scenario, describe_first_error
from mdrive_sumo.scoring import (
    EpisodeKey,
    Results,
    ScenarioResult,
    find_scenario_faults,
    make_void_result,
    save_results,
    summarize_run,
)

J = TypeVar("J")
R = TypeVar("R")
RESULTS_FILE = "results.json"
TRIES = 2
"""How often a scenario without a result is tried: once more after all others, then it is void."""


class StoppedAtFailure(AgentFailure):
    """A run with `fail_fast` stopped at the first failure of an agent; its journal keeps what is finished."""

    def __init__(self, result: ScenarioResult) -> None:
        failed = next(ego for ego in result.egos if ego.outcome is End.AGENT_FAILED)
        kind, _, _ = failed.reason.partition(":")
        super().__init__(FailureReason(kind), f"{result.id}: CAV {failed.id}: {failed.reason}")
        self.result = result


class Progress(Protocol):
    """Receives the progress of a run."""

    def begin(self, total: int, kept: Mapping[EpisodeKey, ScenarioResult]) -> None:
        """The run begins: the number of episodes, and the results kept from an earlier start."""
        ...

    def done(self, result: ScenarioResult) -> None:
        """A scenario has its result."""
        ...

    def show_running(self, running: Mapping[str, float]) -> None:
        """No episode has finished for a while. running: for how long each has been running [s], the oldest first."""
        ...

    def note(self, text: str) -> None:
        """A message for the user: a failed try, a dropped line of the journal."""
        ...


EpisodeExecutor = Executor[EpisodeJob, ScenarioResult | TransferableResult]


def make_episode_executor(workers: int, limit_s: float) -> AbstractContextManager[EpisodeExecutor]:
    """Return worker processes for several runs, so that none starts its own. limit_s: as of `PreparedRun`."""
    return make_executor(run_job, workers, limit_s)


@contextmanager
def start_workers(config: RunConfig) -> Generator[EpisodeExecutor | None]:
    """Yield worker processes for one run, which import while it is prepared; None if `evaluate` has to start them.

    Those of a cluster belong to it, and what an agent that is not built in may take depends on the scenarios.
    """
    if config.scheduler or not config.is_builtin:
        yield None
        return
    with make_episode_executor(config.workers, compute_job_limit_s(0, (), config.pace_ms / 1000)) as executor:
        if isinstance(executor, ProcessPool):
            executor.warm_up()
        yield executor


def evaluate(run: PreparedRun, progress: Progress, executor: EpisodeExecutor | None = None) -> Results:
    """Drive the scenarios that the journal does not hold yet, write `results.json`, and return the results.

    executor: of `make_episode_executor` or `start_workers`; None: this run starts and ends workers of its own.
    Results of earlier starts are kept, void ones are tried again. Raises InputError, KeyboardInterrupt and, with
    `fail_fast`, StoppedAtFailure; the journal then keeps every finished scenario.
    """
    about = {"run": run.info.model_dump(mode="json"), "episodes": len(run.episodes)}
    with open_journal(run.folder, run.fingerprint, fresh=run.config.fresh, about=about) as journal:
        result_by_key = _load_kept_results(run, journal)
        if journal.torn:
            progress.note("the last line of the journal was incomplete and has been dropped")
        episodes = run.episodes
        progress.begin(len(episodes), result_by_key)
        for result in result_by_key.values():
            _check_failure(run, result)
        todo = {key: scenario for key, scenario in episodes.items() if key not in result_by_key}
        if todo:
            with report_write_errors(run.folder):
                run.make_folders()
                (run.folder / RESULTS_FILE).unlink(missing_ok=True)  # until the end it would belong to another journal
            for result in _drive(run, todo, (journal, progress), executor):
                journal.add_result(result.model_dump(mode="json"), _compute_recording_checksum(run, result))
                result_by_key[result.key] = result
                progress.done(result)
                _check_failure(run, result)
        scored = [run.apply_reference_times(scenario, result_by_key[key]) for key, scenario in episodes.items()]
        whole = summarize_run(run.info, scored)
        with report_write_errors(run.folder / RESULTS_FILE):
            save_results(whole, run.folder / RESULTS_FILE)
            _write_whole_transcript(run)
    return whole


def _check_failure(run: PreparedRun, result: ScenarioResult) -> None:
    """Raise StoppedAtFailure if the run has to stop at this result."""
    if run.config.fail_fast and any(ego.outcome is End.AGENT_FAILED for ego in result.egos):
        raise StoppedAtFailure(result)


def _write_whole_transcript(run: PreparedRun) -> None:
    """Concatenate the transcripts of language models into one file, which `eval --transcript` replays."""
    scenarios = tuple(scenario.id for scenario in run.scenarios)
    text = "".join(concatenate_transcripts(run.find_transcripts(seed), scenarios) for seed in run.config.seeds)
    if text:
        write_text(run.folder / TRANSCRIPT_FILE, text)


@contextmanager
def report_write_errors(path: Path) -> Generator[None]:
    """Turn a full disk or a missing permission in the block into an InputError."""
    try:
        yield
    except OSError as error:
        raise InputError(describe_write_error(error, path)) from None


def _compute_recording_checksum(run: PreparedRun, result: ScenarioResult) -> str:
    """Return the checksum of the recording of a result; "" if there is none."""
    path = run.find_recording(result.key)
    return compute_file_checksum(path) if run.config.record and result.status == "ok" else ""


def _load_kept_results(run: PreparedRun, journal: Journal) -> dict[EpisodeKey, ScenarioResult]:
    """Return the results of earlier starts that are not void and have their recording if the run records.

    Raises InputError for an impossible result, one of another run, and a recording that is not the one noted.
    """
    place = run.folder / JOURNAL_FILE
    try:
        entries = [ScenarioResult.model_validate(entry) for entry in journal.results]
        for entry in entries:
            entry.model_dump_json()  # they will be written
    except ValidationError as error:
        raise InputError(f"{place}: {describe_first_error(error)}; --fresh starts anew") from None
    except PydanticSerializationError:
        raise InputError(
            f"{place}: expected text, found a lone surrogate, which no file can hold; --fresh starts anew"
        ) from None
    scenario_ids = {scenario.id for scenario in run.scenarios}
    for entry in entries:
        if entry.id not in scenario_ids:
            raise InputError(f"{place}: expected scenarios of this run, found {entry.id!r:.80}; --fresh starts anew")
        for fault in find_scenario_faults(entry, run.config.score_mode, run.config.seeds):
            raise InputError(f"{place}: {fault}; --fresh starts anew")
    kept = {entry.key: entry for entry in entries if entry.status == "ok"}
    if not run.config.record:
        return kept
    kept = {key: entry for key, entry in kept.items() if run.find_recording(key).is_file()}
    check_recordings(run, kept, journal.found.recordings)
    return kept


def _drive(
    run: PreparedRun,
    todo: Mapping[EpisodeKey, Scenario],
    receivers: tuple[Journal, Progress],
    shared: EpisodeExecutor | None,
) -> Generator[ScenarioResult]:
    """Yield the result of every episode as it finishes. Long ones start first so that no worker idles at the end."""
    journal, progress = receivers
    cost_by_id = {one.id: estimate_cost(one, run.suite.find_folder(one.id)) for one in todo.values()}
    ordered = sorted(todo.items(), key=lambda item: cost_by_id[item[1].id], reverse=True)
    jobs = [run.make_job(scenario, seed) for (_, seed), scenario in ordered]

    def note_failure(job: EpisodeJob, reason: str, is_last: bool) -> None:
        name = run.name_episode((job.scenario, job.seed))
        journal.add_failure(name, reason)
        progress.note(f"{name}: {reason}" + ("" if is_last else "; tried again later"))

    def report_running(running: Sequence[tuple[EpisodeJob, float]]) -> None:
        progress.show_running({run.name_episode((job.scenario, job.seed)): seconds for job, seconds in running})

    with nullcontext(shared) if shared else _make_own_executor(run, len(jobs)) as executor:
        for job, outcome in run_with_retries(executor, jobs, note_failure, report_running):
            if isinstance(outcome, WorkerFailure):
                yield make_void_result(todo[job.scenario, job.seed], job.seed, outcome.reason)
            else:
                yield store_output_files(job, outcome) if isinstance(outcome, TransferableResult) else outcome


def _make_own_executor(run: PreparedRun, jobs: int) -> AbstractContextManager[EpisodeExecutor]:
    scheduler = run.config.scheduler
    function = (
        partial(run_with_output_files, run_job) if scheduler else run_job
    )  # machines of a cluster need not share our disk
    return make_executor(function, min(run.config.workers, jobs), run.limit_s(), scheduler)


def run_with_retries(
    executor: Executor[J, R],
    jobs: Sequence[J],
    note_failure: Callable[[J, str, bool], None],
    report_running: ReportRunning[J] | None = None,
) -> Generator[tuple[J, R | WorkerFailure]]:
    """Yield every job with its result, or with its failure after the last try, in the order in which they finish.

    A job that fails is tried again after all others. note_failure: receives job, reason and whether that was the last
    try. report_running: see `run_jobs`. Raises InputError if a job reports unusable input.
    """
    left = tuple(jobs)
    for tries_left in reversed(range(TRIES)):
        failed: list[J] = []
        for job, outcome in run_jobs(executor, left, report_running):
            if not isinstance(outcome, WorkerFailure):
                yield job, outcome
                continue
            if outcome.kind is FailureKind.INPUT:
                raise InputError(outcome.reason)
            note_failure(job, outcome.reason, not tries_left)
            failed.append(job)
            if not tries_left:
                yield job, outcome
        left = tuple(failed)
