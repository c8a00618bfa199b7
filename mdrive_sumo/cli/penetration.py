"""`mdrive-sumo study penetration`: what it is worth that only a share of the CAVs is connected."""

from typing import Any

import click

from mdrive_sumo.cli.setting_options import setting_option
from mdrive_sumo.cli.study_display import drive_with_display
from mdrive_sumo.cli.study_options import StudyOptions, parse_agent_names, study_options
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.runs.other_agents import SINGLE
from mdrive_sumo.study.penetration import LEVELS, PenetrationStudy, summarise_penetration
from mdrive_sumo.study.plots import draw_penetration
from mdrive_sumo.study.two_agent_files import (
    build_penetration_table,
    penetration_csv,
    penetration_json,
    penetration_markdown,
)


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
def command(ctx: click.Context, agents: str, others: str, levels: str, **options: Any) -> None:
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
    results = (one for row in rows for one in row.results)
    given.end_study(ctx, results, pages, pictures, [table], summary.void)


def _parse_levels(text: str) -> tuple[int, ...]:
    """Return the percentages, ascending. Raises InputError."""
    parts = [part.strip() for part in text.split(",")]
    levels = [int(part) for part in parts if part.isascii() and part.isdigit()]
    if len(levels) < len(parts) or len(set(levels)) < len(levels) or not all(1 <= level <= 99 for level in levels):
        raise InputError(f"study: --penetration: expected different percentages from 1 to 99, found {text!r}")
    return tuple(sorted(levels))
