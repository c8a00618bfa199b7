"""`mdrive-sumo study gain`, `cross-play` and `penetration`: agents by information, among others, and as a share."""

from typing import Any

import click

from mdrive_sumo.agents.registry import AGENTS, HUMAN_AGENTS
from mdrive_sumo.cli.setting_options import setting_option
from mdrive_sumo.cli.study_options import StudyOptions, drive_with_display, parse_agent_names, study_options
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.runs.other_agents import SINGLE
from mdrive_sumo.study.cross_play import CrossPlayStudy, summarise_cross_play
from mdrive_sumo.study.gain import AGENTS as GAIN_AGENTS
from mdrive_sumo.study.gain import GainStudy, summarise_gain
from mdrive_sumo.study.gain_files import build_gain_table, gain_csv, gain_json, gain_markdown
from mdrive_sumo.study.penetration import LEVELS, PenetrationStudy, summarise_penetration
from mdrive_sumo.study.plots import draw_cross_play, draw_penetration
from mdrive_sumo.study.two_agent_files import (
    build_matrix,
    build_penetration_table,
    build_strangers_table,
    cross_play_csv,
    cross_play_json,
    cross_play_markdown,
    penetration_csv,
    penetration_json,
    penetration_markdown,
)


@click.command("gain")
@study_options(suite="mdrive", seed=1, seeds=5)
@click.pass_context
def gain_command(ctx: click.Context, **options: Any) -> None:
    """Split the gain of sharing into occlusion, noise and intent.

    Drives single and sharing under both sensing profiles, sharing+negotiation under the realistic one. Writes
    gain.json, gain.csv and gain.md into --out, and every run into --out/runs. The same command given again continues
    an interrupted study.

    Exit codes: 0 every scenario has a score, 1 some are void or an agent failed, 2 unusable input, 130 interrupted.
    """
    given = StudyOptions(**options, agent_limits=None)  # its agents are built in, and have no limits
    study = GainStudy({name: given.prepare_agent(name) for name in GAIN_AGENTS}, given.all_seeds, given.out)
    rows = drive_with_display(ctx, study)
    summary = summarise_gain(rows)
    about = given.describe(rows)
    pages = {
        "gain.json": gain_json(about, rows, summary),
        "gain.csv": gain_csv(summary),
        "gain.md": gain_markdown(about, rows, summary),
    }
    table = format_text(build_gain_table(summary))
    given.end_study(ctx, rows, pages, (), [table], summary.void)


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
def cross_play_command(ctx: click.Context, agents: str, **options: Any) -> None:
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
    given.end_study(ctx, rows, pages, pictures, tables, summary.void)


def list_all_agents() -> str:
    """Return the names of all built-in agents that drive by themselves and without options, with commas between."""
    names: list[str] = []
    for name in (one for one in AGENTS if one not in HUMAN_AGENTS):
        try:
            AGENTS[name]({})
        except InputError as error:
            echo(f"left out: {name}: {error}", err=True)
        else:
            names.append(name)
    return ",".join(names)


@click.command("penetration")
@click.option(
    "--agents",
    default="sharing,sharing+negotiation",
    show_default=True,
    metavar="A,B,...",
    help="Agents, each as --agent of `eval`.",
)
@setting_option("others", default=SINGLE, show_default=True, help="Agent of the other CAVs.")
@click.option(
    "--penetration",
    "levels",
    default=",".join(map(str, LEVELS)),
    show_default=True,
    metavar="PERCENT,...",
    help="Shares of the CAVs that drive as the agent; 0 and 100 are always driven.",
)
@study_options(suite="interdrive", seed=0, seeds=1)
@setting_option("agent_limits")
@click.pass_context
def penetration_command(ctx: click.Context, agents: str, others: str, levels: str, **options: Any) -> None:
    """Measure agents of which only a share of the CAVs drives, the others being another agent's.

    Writes penetration.json, .csv, .md and the curves as .png and .svg into --out, and every run into --out/runs. The
    same command given again continues an interrupted study.

    Exit codes: 0 every scenario has a score, 1 some are void or an agent failed, 2 unusable input, 130 interrupted.
    """
    given = StudyOptions(**options)
    names = parse_agent_names(agents)
    if others in names:
        raise InputError(f"study: --others: expected an agent that is not among --agents, found {others!r}")
    study = PenetrationStudy(
        {name: given.prepare_agent(name) for name in names},
        given.prepare_agent(others),
        _parse_levels(levels),
        given.all_seeds,
        given.out,
    )
    rows = drive_with_display(ctx, study)
    summary = summarise_penetration(rows)
    about = given.describe(rows)
    pages = {
        "penetration.json": penetration_json(about, rows, summary),
        "penetration.csv": penetration_csv(summary),
        "penetration.md": penetration_markdown(about, rows, summary),
    }
    pictures = draw_penetration(summary, about.suite, given.out / "penetration")
    table = format_text(build_penetration_table(summary))
    given.end_study(ctx, rows, pages, pictures, [table], summary.void)


def _parse_levels(text: str) -> tuple[int, ...]:
    """Return the percentages, ascending. Raises InputError."""
    parts = [part.strip() for part in text.split(",")]
    levels = [int(part) for part in parts if part.isascii() and part.isdigit()]
    if len(levels) < len(parts) or len(set(levels)) < len(levels) or not all(1 <= level <= 99 for level in levels):
        raise InputError(f"study: --penetration: expected different percentages from 1 to 99, found {text!r}")
    return tuple(sorted(levels))
