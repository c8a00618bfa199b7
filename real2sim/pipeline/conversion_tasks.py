"""Tasks of the worker processes of a batch. `conversion_worker` does them: what it imports, only workers need."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mdrive_sumo.runs.imported_function import ImportedFunction
from real2sim.pipeline.conversion_options import ConversionOptions

if TYPE_CHECKING:
    from real2sim.fidelity_report.index_page import IndexRow
    from real2sim.pipeline.log_source import LogSource
    from real2sim.readers.time_grid import TimeWindow

DESCRIPTION = "Converted from logs by mdrive-sumo convert."
"""Of a suite."""


@dataclass(frozen=True)
class ConversionTask:
    """Convert one log into a folder."""

    number: int
    log: "LogSource"
    options: ConversionOptions
    report: bool
    folder: Path


@dataclass(frozen=True)
class SplitTask:
    """Split one log into windows of `every_s` [s]."""

    number: int
    log: "LogSource"
    every_s: float


@dataclass(frozen=True)
class SuiteTask:
    """Write `suite.json`, and the index page if there are rows, beside the scenarios in a folder."""

    folder: Path
    name: str
    rows: "tuple[IndexRow, ...]"


@dataclass(frozen=True)
class ConvertedScenario:
    """A scenario of the draft and what the final report says about it."""

    id: str
    misses: tuple[str, ...]
    """One sentence for each missed target."""
    index_row: "IndexRow | None"
    """Row of the index page, if pages are written."""


Task = ConversionTask | SplitTask | SuiteTask
if TYPE_CHECKING:
    Answer = ConvertedScenario | tuple[TimeWindow, ...] | Path | str
    """The scenario, the windows, the folder of the suite; or a sentence: why the log has none."""
RUN_TASK: "ImportedFunction[Task, Answer]" = ImportedFunction("real2sim.pipeline.conversion_worker", "run_task")
