"""Options that studies of agents share: suite, channel, seeds, folder."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NoReturn, Protocol

import click

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.cli.options import get_command_line
from mdrive_sumo.cli.setting_options import add_options, parse_comm_options, seed_options, setting_option
from mdrive_sumo.cli.study_display import warn_about_failures
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.private_paths import hide_command
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.episode.episode_options import EpisodeOptions
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.evaluate import report_write_errors
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare
from mdrive_sumo.runs.run_config import ConfigValue, RunConfig
from mdrive_sumo.scoring import Results
from mdrive_sumo.study.conditions import Level
from mdrive_sumo.study.study_files import StudyDescription


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
        return EpisodeOptions(parse_comm_options(self.comm))

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
        results: Iterable[Results],
        pages: Mapping[str, str],
        pictures: Sequence[Path],
        tables: Sequence[str],
        void: int,
    ) -> NoReturn:
        """Write pages, by file name; print tables, paths and a line for each failed agent; exit.

        The exit code is 1 if an agent failed or scenarios are void, else 0. Raises InputError.
        """
        paths = [self.out / name for name in pages]
        for path, text in zip(paths, pages.values(), strict=True):
            with report_write_errors(path):
                write_text(path, text)
        echo("\n\n".join((*tables, "\n".join(map(str, (*paths, *pictures))))))
        failed = warn_about_failures(results, self.out)
        ctx.exit(1 if failed or void else 0)


def parse_agent_names(text: str, fewest: int = 1) -> Sequence[str]:
    """Return the agents of a list with commas. Raises InputError for one twice, an empty one, or too few."""
    names = [name.strip() for name in text.split(",")]
    if "" in names or len(set(names)) < len(names) or len(names) < fewest:
        count = f"at least {fewest} " if fewest > 1 else ""
        raise InputError(f"study: --agents: expected {count}different agents with commas between them, found {text!r}")
    return names
