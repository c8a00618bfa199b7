"""What worker processes of a batch do."""

import os
from pathlib import Path

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.scenario.suite import Suite, SuiteFile, save_suite
from real2sim.pipeline.conversion_tasks import (
    DESCRIPTION,
    ConversionTask,
    ConvertedScenario,
    SplitTask,
    SuiteTask,
    Task,
)
from real2sim.pipeline.log_conversion import convert_log, split_into_windows
from real2sim.readers.time_grid import TimeWindow


def run_task(task: Task) -> ConvertedScenario | tuple[TimeWindow, ...] | Path | str:
    """Do a task; return what there is then, or a sentence about the log that is unusable."""
    _redirect_stdout()
    if isinstance(task, SuiteTask):
        return _write_suite(task)
    try:
        return _convert(task) if isinstance(task, ConversionTask) else _split(task)
    except InputError as error:
        return str(error)


def _convert(task: ConversionTask) -> ConvertedScenario:
    """Convert the log, then draw its page."""
    built = convert_log(task.log, task.folder, task.options)
    row = None
    if task.report:
        from real2sim.fidelity_report.index_page import build_index_row
        from real2sim.fidelity_report.report_page import write_report

        write_report(task.folder / built.scenario.id, built.findings)
        row = build_index_row(built.findings)
    return ConvertedScenario(built.scenario.id, built.findings.misses, row)


def _split(task: SplitTask) -> tuple[TimeWindow, ...]:
    return split_into_windows(task.log, task.every_s)


def _write_suite(task: SuiteTask) -> Path:
    about = SuiteFile(name=task.name, title=task.name, description=DESCRIPTION)
    save_suite(Suite(about, task.folder, ()))
    if task.rows:
        from real2sim.fidelity_report.index_page import write_index

        write_index(task.folder, task.name, task.rows)
    return task.folder


def _redirect_stdout() -> None:
    """Redirect standard output to standard error: SUMO and pyarrow print warnings where our results go."""
    os.dup2(2, 1)
