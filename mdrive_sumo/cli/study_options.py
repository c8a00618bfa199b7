"""What the commands of `study` share: options, progress on a terminal, and how they end."""

import sys
from collections import Counter
from collections.abc import Callable, Container, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, Protocol, TextIO, TypeVar

import click

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.cli.options import get_command_line
from mdrive_sumo.cli.setting_options import add_options, parse_comm_options, seed_options, setting_option
from mdrive_sumo.core.clean_text import clean_line
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.private_paths import hide_command
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.report.agent_failures import list_agent_failures
from mdrive_sumo.report.progress import ProgressDisplay
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare
from mdrive_sumo.runs.run_config import ConfigValue, RunConfig, load_agent_config
from mdrive_sumo.scoring import EpisodeKey, Results, ScenarioResult
from mdrive_sumo.study.conditions import Level
from mdrive_sumo.study.paper.paper_study import PaperProgress
from mdrive_sumo.study.study_files import StudyDescription
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


def study_options(*, suite: str, seed: int, seeds: int) -> Callable[[Callable[..., Any]], Callable[..., Any]]:
    """Return a decorator that adds the options of `StudyOptions` to a command, with these defaults."""
    return add_options(
        [
            setting_option("suite", default=suite),
            setting_option("scenario"),
            setting_option("comm"),
            *seed_options(seed=seed, seeds=seeds, first="The first seed.", count="How many seeds."),
            setting_option("record", help="Keep no recordings: no view or verify of single runs."),
            setting_option("fresh", help="Start anew instead of continuing an interrupted study."),
            setting_option("out", required=True, help="The study's folder."),
            setting_option("workers"),
        ]
    )


class DrivenRow(Protocol):
    """A row of a study."""

    @property
    def results(self) -> Sequence[Results]:
        """The results of its runs, one for each seed."""
        ...


@dataclass(frozen=True, slots=True)
class StudyOptions:
    """What the user asked for."""

    suite: str
    scenario: str
    comm: str
    seed: int
    seeds: int
    record: bool
    fresh: bool
    out: Path
    workers: int
    agent_limits: AgentLimits | None

    @property
    def all_seeds(self) -> tuple[int, ...]:
        """Every seed of the study."""
        return tuple(range(self.seed, self.seed + self.seeds))

    def make_episode_options(self) -> EpisodeOptions:
        """Return the conditions of every episode. Raises InputError."""
        return EpisodeOptions.parse(comm=parse_comm_options(self.comm))

    def prepare_agent(self, name: str, agent_config: Mapping[str, ConfigValue] | None = None) -> PreparedRun:
        """Return the run of an agent with the first seed. Raises InputError."""
        spec = AgentSpec(name, agent_config or {})
        config = RunConfig(
            suite=self.suite,
            scenario=self.scenario,
            agent=spec if spec.is_builtin or self.agent_limits is None else spec.with_limits(self.agent_limits),
            seeds=(self.seed,),
            options=self.make_episode_options(),
            record=self.record,
            workers=self.workers,
            out=self.out,
            fresh=self.fresh,
            command=get_command_line(),
        )
        return prepare(config)

    def describe(
        self, rows: Sequence[DrivenRow], grid: str = "", factors: Mapping[str, Sequence[Level]] | None = None
    ) -> StudyDescription:
        """Return the study for its files. grid and factors: of a channel study."""
        suite = rows[0].results[0].run.suite
        return StudyDescription(
            suite, self.scenario, grid, factors or {}, self.all_seeds, hide_command(get_command_line(), self.out)
        )

    def end_study(
        self,
        ctx: click.Context,
        rows: Iterable[DrivenRow],
        pages: Mapping[str, str],
        pictures: Sequence[Path],
        tables: Sequence[str],
        void: int,
    ) -> NoReturn:
        """Write pages, by file name; print tables, paths and a line for each agent that failed in the rows; exit.

        The exit code is 1 if an agent failed or scenarios are void, else 0. Raises InputError.
        """
        paths = [self.out / name for name in pages]
        for path, text in zip(paths, pages.values(), strict=True):
            with report_write_errors(path):
                write_text(path, text)
        echo("\n\n".join((*tables, "\n".join(map(str, (*paths, *pictures))))))
        failed = warn_about_failures((results for row in rows for results in row.results), self.out)
        ctx.exit(1 if failed or void else 0)


agent_config_option = click.option(
    "--agent-config", multiple=True, metavar="AGENT=FILE", help="Options of one agent, a JSON object."
)


def parse_agent_configs(given: Sequence[str], names: Container[str]) -> dict[str, dict[str, ConfigValue]]:
    """Return the options of agents. given: of `agent_config_option`. Raises InputError, also for none of the names."""
    config_by_agent: dict[str, dict[str, ConfigValue]] = {}
    for text in given:
        name, _, path = text.partition("=")
        if name not in names or not path:
            raise InputError(f"study: --agent-config: expected AGENT=FILE with one of --agents, found {text!r}")
        config_by_agent[name] = load_agent_config(Path(path))
    return config_by_agent


def parse_agent_names(text: str, fewest: int = 1, option: str = "--agents") -> Sequence[str]:
    """Return the agents of a list with commas. Raises InputError for one twice, an empty one, or too few."""
    names = [name.strip() for name in text.split(",")]
    if "" in names or len(set(names)) < len(names) or len(names) < fewest:
        count = f"at least {fewest} " if fewest > 1 else ""
        raise InputError(f"study: {option}: expected {count}different agents with commas between them, found {text!r}")
    return names
