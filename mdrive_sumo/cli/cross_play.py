"""`mdrive-sumo study cross-play`: every agent among CAVs of every other agent."""

from typing import Any

import click

from mdrive_sumo.agents.registry import AGENTS
from mdrive_sumo.cli.setting_options import setting_option
from mdrive_sumo.cli.study_display import drive_with_display
from mdrive_sumo.cli.study_options import StudyOptions, parse_agent_names, study_options
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.study.cross_play import CrossPlayStudy, summarise_cross_play
from mdrive_sumo.study.plots import draw_cross_play
from mdrive_sumo.study.two_agent_files import (
    build_matrix,
    build_strangers_table,
    cross_play_csv,
    cross_play_json,
    cross_play_markdown,
)

DEFAULT_AGENTS = "idm,single,sharing,colmdriver-rule,sharing+negotiation"
"""Built-in agents that react to other vehicles: constant-speed, stationary and take-turns do not."""
ALL_AGENTS = "all"


@click.command("cross-play")
@click.option(
    "--agents",
    default=DEFAULT_AGENTS,
    show_default=True,
    metavar="A,B,...|all",
    help="Agents, each as --agent of `eval`; all: every built-in agent that drives without options.",
)
@study_options(suite="interdrive", seed=0, seeds=1)
@setting_option("agent_limits")
@click.pass_context
def command(ctx: click.Context, agents: str, **options: Any) -> None:
    """Measure how well agents drive with partners that they were not built for.

    Each agent drives one CAV of every scenario, drawn by the seed, among CAVs of each agent: as many runs as pairs.
    Writes cross-play.json, .csv, .md and the matrix as .png and .svg into --out, and every run into --out/runs. The
    same command given again continues an interrupted study.

    Exit codes: 0 every scenario has a score, 1 some are void or an agent failed, 2 unusable input, 130 interrupted.
    """
    given = StudyOptions(**options)
    names = parse_agent_names(list_all_agents() if agents == ALL_AGENTS else agents, fewest=2)
    study = CrossPlayStudy({name: given.prepare_agent(name) for name in names}, given.all_seeds, given.out)
    rows = drive_with_display(ctx, study)
    summary = summarise_cross_play(rows)
    about = given.describe(rows)
    pages = {
        "cross-play.json": cross_play_json(about, rows, summary),
        "cross-play.csv": cross_play_csv(summary),
        "cross-play.md": cross_play_markdown(about, rows, summary),
    }
    pictures = draw_cross_play(summary, about.suite, given.out / "cross-play")
    tables = (
        format_text(build_strangers_table(summary)),
        format_text(build_matrix(summary)),
    )
    results = (one for row in rows for one in row.results)
    given.end_study(ctx, results, pages, pictures, tables, summary.void)


def list_all_agents() -> str:
    """Return the names of all built-in agents that drive without options, with commas between them."""
    names: list[str] = []
    for name, factory in AGENTS.items():
        try:
            factory({})
        except InputError as error:
            echo(f"left out: {name}: {error}", err=True)
        else:
            names.append(name)
    return ",".join(names)
