"""Progress of a study on a terminal."""

import sys
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Protocol, TextIO, TypeVar

import click

from mdrive_sumo.core.clean_text import clean_line
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.agent_failures import list_agent_failures
from mdrive_sumo.report.progress import ProgressDisplay
from mdrive_sumo.scoring import EpisodeKey, Results, ScenarioResult
from mdrive_sumo.study.paper.paper_study import PaperProgress
from mdrive_sumo.study.study_runs import RUNS_FOLDER

Row = TypeVar("Row", covariant=True)


class DrivenStudy(Protocol[Row]):
    """A study that yields its rows as they are driven."""

    @property
    def folder(self) -> Path:
        """Where the study keeps its runs."""
        ...

    def episodes(self) -> int:
        """Return the number of episodes."""
        ...

    def rows(self, progress: PaperProgress) -> Iterator[Row]:
        """Drive the unfinished runs and yield the rows."""
        ...


class StudyDisplay(ProgressDisplay):
    """Progress over all runs of a study."""

    def __init__(self, stream: TextIO, total: int) -> None:
        super().__init__(stream)
        self._total = total
        self._compared = 0
        self._name = ""

    def run(self, name: str) -> None:
        """See StudyProgress."""
        self._name = name
        self.note(f"{name}:")

    def spared(self, scenarios: int) -> None:
        """See StudyProgress."""
        self._total -= scenarios

    def compared(self, name: str) -> None:
        """See PaperProgress."""
        self._compared += 1
        if self._live:
            self._draw(name)
        else:
            self._write(f"{self._state()}  {clean_line(name)} compared\n")

    def begin(self, total: int, kept: Mapping[EpisodeKey, ScenarioResult]) -> None:
        """See Progress: one of the study's runs begins."""
        self._kept += len(kept)
        self._results += kept.values()
        if kept:
            self.note(f"  {len(kept)} of {total} scenarios are done already")

    def _state(self) -> str:
        return f"{self._count_done():{len(str(self._total))}}/{self._total}  eta {self._time_left()}"

    def _count_done(self) -> int:
        return super()._count_done() + self._compared


def drive_with_display(ctx: click.Context, study: DrivenStudy[Row]) -> list[Row]:
    """Drive a study with a display on standard error; an interruption ends the program with code 130."""
    progress = StudyDisplay(sys.stderr, study.episodes())
    try:
        return list(study.rows(progress))
    except KeyboardInterrupt:
        progress.close()
        echo(f"interrupted; the same command without --fresh continues {study.folder}", err=True)
        ctx.exit(130)
    finally:
        progress.close()


def warn_about_failures(found: Iterable[Results], folder: Path) -> bool:
    """Print how many episodes of each agent have a failed agent; return whether there are any."""
    counts = Counter(
        results.run.agent
        for results in found
        for _ in {(failure.result.id, failure.result.seed) for failure in list_agent_failures(results)}
    )
    for agent, count in counts.items():
        echo(f"THE AGENT {agent} FAILED in {count} episodes; logs and reports: {folder / RUNS_FOLDER}", err=True)
    return bool(counts)
