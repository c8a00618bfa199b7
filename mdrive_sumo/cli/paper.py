"""`mdrive-sumo study paper`: the counterparts of the paper's tables and figures."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import click

from mdrive_sumo.agent_process.agent_connection import AgentLimits
from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.cli.options import get_command_line, workers_option
from mdrive_sumo.cli.setting_options import add_options, seed_options, setting_option
from mdrive_sumo.cli.study_options import (
    agent_config_option,
    drive_with_display,
    parse_agent_configs,
    parse_agent_names,
    warn_about_failures,
)
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.private_paths import hide_command
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.open_loop import OpenLoopResults
from mdrive_sumo.report.comparison_report.score_tables import build_main_table
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.runs.prepared_run import PreparedRun, prepare, prepare_with_suite
from mdrive_sumo.runs.run_config import ConfigValue, RunConfig
from mdrive_sumo.study.human.human_results import HumanStudyResults
from mdrive_sumo.study.human.write_human_results import load_stored_human_results
from mdrive_sumo.study.paper.detector_order import Precisions
from mdrive_sumo.study.paper.paper_agents import prepare_installed_agents
from mdrive_sumo.study.paper.paper_files import write_paper
from mdrive_sumo.study.paper.paper_numbers import compute_paper_numbers
from mdrive_sumo.study.paper.paper_plan import PaperScale, make_plan
from mdrive_sumo.study.paper.paper_report import PaperRequest
from mdrive_sumo.study.paper.paper_study import REFERENCE, PaperStudy
from mdrive_sumo.study.paper.study_folder import claim_folder, describe_study
from mdrive_sumo.study.study_runs import RUNS_FOLDER


@click.command("paper")
@setting_option("out", required=True, help="The study's folder.")
@click.option("--quick", is_flag=True, help="Eight scenarios, to see within minutes what comes out.")
@click.option("--all-scenarios", is_flag=True, help="Every scenario, not a quarter of each category.")
@click.option(
    "--agents", metavar="A,B,...", help="Agents, each as --agent of `eval` [default: all that are installed]."
)
@agent_config_option
@click.option(
    "--human-study",
    type=click.Path(path_type=Path),
    metavar="DIR",
    help="A study with persons (study human), whose results are written, for RQ4 [default: none].",
)
@click.option(
    "--detectors",
    type=click.Path(path_type=Path),
    metavar="FILE",
    help="detectors.json of `learn evaluate-detectors`, whose precisions stand beside driving in RQ3 [default: none].",
)
@setting_option("suite", default="mdrive")
@add_options(seed_options(first="The first seed; 0: as written.", count="How many seeds."))
@setting_option("record_features")
@setting_option("fresh", help="Start anew instead of continuing an interrupted study.")
@setting_option("agent_limits")
@workers_option
@click.pass_context
def command(ctx: click.Context, **options: object) -> None:
    """Measure the counterpart of every table and figure of the MDrive paper.

    Drives every agent in closed loop (RQ1, RQ2), shows it recorded drives in open loop (RQ3), and drives agents that
    exchange messages over the paper's worse channels (RQ5). Writes paper.md, paper.html, paper.json, every table as
    .tex and .csv and the figures into --out, and every run into --out/runs. The same command given again continues an
    interrupted study.

    Exit codes: 0 every scenario has a score, 1 some are void or an agent failed, 2 unusable input, 130 interrupted.
    """
    given = _PaperOptions(**options)  # pyright: ignore[reportArgumentType] - click has made them what the fields say
    prepared = given.prepare_study()
    for name, why in prepared.left_out.items():
        echo(f"left out: {name}: {why}", err=True)
    rows = drive_with_display(ctx, prepared.study)
    numbers = compute_paper_numbers(prepared.study, rows, prepared.precisions)
    request = PaperRequest(hide_command(get_command_line(), given.out), prepared.left_out, prepared.humans)
    pages = write_paper(given.out, numbers, request, prepared.about)
    echo(format_text(build_main_table(numbers.compared)))
    echo("\n" + "\n".join(map(str, pages)))
    failed = warn_about_failures(numbers.runs, given.out)
    failed = _warn_about_open_failures(numbers.open, given.out) or failed
    ctx.exit(1 if failed or any(run.void for run in numbers.runs) else 0)


def _load_precisions(path: Path) -> Precisions:
    from mdrive_sumo.learning.fusion.detectors_file import list_compared, read_detectors

    return list_compared(read_detectors(path))


def _warn_about_open_failures(opened: Mapping[str, OpenLoopResults], folder: Path) -> bool:
    """Print in how many recordings each agent failed in open loop; return whether there are any."""
    counts = {
        agent: sum(bool(scenario.failures) for scenario in results.scenarios) for agent, results in opened.items()
    }
    failed = {agent: count for agent, count in counts.items() if count}
    for agent, count in failed.items():
        echo(f"THE AGENT {agent} FAILED in {count} recordings of the open loop: {folder / RUNS_FOLDER}", err=True)
    return bool(failed)


@dataclass(frozen=True, slots=True)
class _PreparedStudy:
    study: PaperStudy
    left_out: Mapping[str, str]
    """Why built-in agents are left out, by agent."""
    about: Mapping[str, Any]
    """The content of `study_plan.json`."""
    humans: HumanStudyResults | None
    precisions: Precisions


@dataclass(frozen=True, slots=True)
class _PaperOptions:
    """The options of `study paper`."""

    out: Path
    quick: bool
    all_scenarios: bool
    agents: str | None
    agent_config: tuple[str, ...]
    human_study: Path | None
    detectors: Path | None
    suite: str
    seed: int
    seeds: int
    record_features: bool
    fresh: bool
    workers: int
    agent_limits: AgentLimits | None

    def prepare_study(self) -> _PreparedStudy:
        """Return the study, and claim its folder. Raises InputError before anything is driven."""
        names = self._parse_agents()
        configs = parse_agent_configs(self.agent_config, names or AGENTS)
        humans = load_stored_human_results(self.human_study) if self.human_study is not None else None
        precisions = _load_precisions(self.detectors) if self.detectors is not None else {}
        reference = prepare(self._make_config(REFERENCE, configs.get(REFERENCE, {})))
        plan = make_plan(reference.suite, self._choose_scale())

        def prepare_agent(name: str) -> PreparedRun:
            if name == REFERENCE:
                return reference
            return prepare_with_suite(self._make_config(name, configs.get(name, {})), reference.suite)

        agents, left_out = prepare_installed_agents(prepare_agent, names)
        about = describe_study(reference.config, reference.suite, plan)
        claim_folder(self.out, about, fresh=self.fresh)
        return _PreparedStudy(PaperStudy(plan, agents, reference, self.out), left_out, about, humans, precisions)

    def _choose_scale(self) -> PaperScale:
        """Return how many scenarios are driven. Raises InputError."""
        if self.quick and self.all_scenarios:
            raise InputError("study paper: expected --quick or --all-scenarios, found both")
        if self.quick:
            return PaperScale.QUICK
        return PaperScale.WHOLE if self.all_scenarios else PaperScale.STANDARD

    def _parse_agents(self) -> Sequence[str]:
        """Return the agents that are named; none: all that are installed. Raises InputError."""
        if self.agents is None:
            return ()
        return parse_agent_names(self.agents)

    def _make_config(self, agent: str, agent_config: Mapping[str, ConfigValue]) -> RunConfig:
        spec = AgentSpec(agent, agent_config)
        return RunConfig(
            suite=self.suite,
            agent=spec if spec.is_builtin or self.agent_limits is None else spec.with_limits(self.agent_limits),
            seeds=tuple(range(self.seed, self.seed + self.seeds)),
            record_features=self.record_features,
            workers=self.workers,
            out=self.out,
            fresh=self.fresh,
            command=get_command_line(),
        )
