"""Conversion of many logs: each in a worker process of its own; the suite appears on disk as a whole or not at all."""

import shutil
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

from mdrive_sumo.core.atomic_folder import atomic_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.runs.process_pool import FailureKind, ProcessPool, WorkerFailure
from real2sim.pipeline.conversion_options import NETWORKS, ConversionOptions
from real2sim.pipeline.conversion_tasks import (
    RUN_TASK,
    ConversionTask,
    ConvertedScenario,
    SplitTask,
    SuiteTask,
    Task,
)
from real2sim.pipeline.log_source import LogSource, describe_part, prefix_with_log

if TYPE_CHECKING:  # only workers import what converts: it takes half a second
    from real2sim.pipeline.conversion_tasks import Answer
    from real2sim.readers.time_grid import TimeWindow

LIMIT_S = 900.0
"""[s] Wall-clock limit for one log."""
PARTS = ".parts"
SUITE_FILE = "suite.json"


@dataclass(frozen=True)
class BatchResult:
    """Results of all logs in the order in which they were given."""

    outcomes: tuple[ConvertedScenario, ...]
    refused: tuple[str, ...]
    """One sentence for each log that could not be converted."""

    @property
    def below_target(self) -> tuple[ConvertedScenario, ...]:
        """Scenarios that miss a target."""
        return tuple(outcome for outcome in self.outcomes if outcome.misses)


class NoLogConvertedError(InputError):
    """None of several logs can be converted."""

    def __init__(self, refused: Sequence[str]) -> None:
        """refused: a sentence about each log."""
        super().__init__("; ".join(refused) or "expected at least one log, found none")
        self.refused = tuple(refused)


def _ignore_progress(_done: int, _total: int, _text: str) -> None:
    """Report nothing."""


@dataclass(frozen=True)
class BatchOptions:
    """Options of a batch."""

    conversion: ConversionOptions = field(default_factory=ConversionOptions)
    report: bool = False
    every_s: float | None = None
    """[s] Splits every log into scenarios of this length."""
    workers: int = 1
    progress: Callable[[int, int, str], None] = _ignore_progress
    """Called with the number of finished logs, the number of logs, and the result of the last one."""


def convert_logs(logs: Sequence[LogSource], out: Path, name: str, options: BatchOptions) -> BatchResult:
    """Write the suite `name` of all logs that can be converted; raises InputError if `out` cannot be written,
    NoLogConvertedError if there is none.

    `out`, which must be new or empty, appears only at the end, complete.
    """
    with atomic_folder(out) as draft, ProcessPool(RUN_TASK, options.workers, LIMIT_S) as pool:
        parts = draft / PARTS
        tasks, refused = _plan_tasks(logs, parts, options, pool)
        answers = dict(_report_answers(pool.run(tasks), len(tasks), options))
        outcomes: list[ConvertedScenario] = []
        for task in tasks:
            answer = answers[task.number]
            if isinstance(answer, ConvertedScenario):
                answer = _move_into_suite(answer, task, draft, outcomes)
            if isinstance(answer, ConvertedScenario):
                outcomes.append(answer)
            else:
                refused.append(answer)
        if not outcomes:
            raise NoLogConvertedError(refused)
        shutil.rmtree(parts)
        _write_suite(SuiteTask(draft, name, tuple(one.index_row for one in outcomes if one.index_row)), pool)
    return BatchResult(tuple(outcomes), tuple(refused))


def _plan_tasks(
    logs: Sequence[LogSource], parts: Path, options: BatchOptions, pool: "ProcessPool[Task, Answer]"
) -> tuple[list[ConversionTask], list[str]]:
    """Return a task for every log, or for every window of every log, and a sentence for each log that cannot be
    split."""
    once, refused = _reject_repeated(logs)
    if options.every_s is not None:
        once, unsplit = _split_logs(once, options.every_s, pool)
        refused += unsplit
    tasks = [ConversionTask(i, log, options.conversion, options.report, parts / str(i)) for i, log in enumerate(once)]
    return tasks, refused


def _split_logs(
    logs: Sequence[LogSource], every_s: float, pool: "ProcessPool[Task, Answer]"
) -> tuple[list[LogSource], list[str]]:
    """Return the windows of the logs, and a sentence for each log that cannot be split."""
    answers: dict[int, Answer] = {}
    for task, answer in pool.run([SplitTask(i, log, every_s) for i, log in enumerate(logs)]):
        assert isinstance(task, SplitTask)
        answers[task.number] = _describe_failure(answer) if isinstance(answer, WorkerFailure) else answer
    ordered = [answer for _, answer in sorted(answers.items())]
    windows = [
        replace(log, window=window)
        for log, answer in zip(logs, ordered, strict=True)
        if isinstance(answer, tuple)
        for window in answer
    ]
    return windows, [answer for answer in ordered if isinstance(answer, str)]


def _write_suite(task: SuiteTask, pool: "ProcessPool[Task, Answer]") -> None:
    for _, answer in pool.run([task]):
        if isinstance(answer, WorkerFailure):
            raise InputError(f"{SUITE_FILE}: {_describe_failure(answer)}")


def _reject_repeated(logs: Sequence[LogSource]) -> tuple[list[LogSource], list[str]]:
    """Return the logs without repetitions, and a sentence for each repetition."""
    once: dict[tuple[Path, str, TimeWindow | None], LogSource] = {}
    refused: list[str] = []
    for log in logs:
        if once.setdefault((log.path.resolve(), log.case, log.window), log) is not log:
            refused.append(prefix_with_log(log, "expected every log once, found it twice"))
    return list(once.values()), refused


def _describe_failure(failure: WorkerFailure) -> str:
    """Describe the failure of one log; raises InputError for a failure that concerns all logs, such as a full disk."""
    if failure.kind is FailureKind.INPUT:
        raise InputError(failure.reason)
    return f"conversion failed: {failure.reason}"


def _report_answers(
    done: "Iterable[tuple[Task, Answer | WorkerFailure]]", total: int, options: BatchOptions
) -> Iterator[tuple[int, ConvertedScenario | str]]:
    ids: set[str] = set()
    for i, (task, answer) in enumerate(done, 1):
        assert isinstance(task, ConversionTask)
        if isinstance(answer, WorkerFailure):
            answer = prefix_with_log(task.log, _describe_failure(answer))
        assert isinstance(answer, ConvertedScenario | str)
        title = ", ".join(filter(None, (task.log.path.name, describe_part(task.log))))
        options.progress(i, total, f"{title}: {_format_verdict(answer, ids)}")
        ids |= {answer.id} if isinstance(answer, ConvertedScenario) else set()
        yield task.number, answer


def _format_verdict(answer: ConvertedScenario | str, before: Collection[str]) -> str:
    """Describe the result; `before` are the scenario ids of earlier logs, each of which may occur once in a suite."""
    if isinstance(answer, str):
        return "unusable"
    if answer.id in before:
        return f"unusable, the second {answer.id}"
    count = len(answer.misses)
    return f"misses {count} target{'' if count == 1 else 's'}" if count else "passed"


def _move_into_suite(
    outcome: ConvertedScenario, task: ConversionTask, draft: Path, before: Sequence[ConvertedScenario]
) -> ConvertedScenario | str:
    """Move a finished scenario and its network into the suite; return a sentence if its id is taken."""
    if any(outcome.id == other.id for other in before):
        return prefix_with_log(task.log, f"expected logs of different names, found {outcome.id} twice")
    make_folder(draft / NETWORKS)
    (task.folder / outcome.id).rename(draft / outcome.id)
    (task.folder / NETWORKS / outcome.id).rename(draft / NETWORKS / outcome.id)
    return outcome
