"""`mdrive-sumo study twins`: what each factor of a scenario costs each agent."""

from dataclasses import replace
from typing import Any

import click

from mdrive_sumo.cli.setting_options import setting_option
from mdrive_sumo.cli.study_options import StudyOptions, drive_with_display, parse_agent_names, study_options
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.runs.agent_spec import AgentSpec
from mdrive_sumo.study.plots import draw_twins
from mdrive_sumo.study.twin_scenarios import TwinFactor
from mdrive_sumo.study.twins import TwinStudy, summarise_twins
from mdrive_sumo.study.twins_files import (
    build_gap_table,
    build_twins_table,
    twin_episodes_csv,
    twins_csv,
    twins_json,
    twins_markdown,
)

DEFAULT_AGENTS = ("single", "sharing", "sharing+negotiation")
STRANGER = "idm"
"""Follows and yields as SUMO's drivers do, and sends nothing: the nearest to a car that is no CAV."""


@click.command("twins")
@click.option(
    "--agent",
    "agents",
    multiple=True,
    default=DEFAULT_AGENTS,
    show_default=True,
    metavar="AGENT",
    help="Agent as --agent of `eval`; may be repeated.",
)
@click.option(
    "--factor",
    "factors",
    multiple=True,
    type=click.Choice([factor.value for factor in TwinFactor]),
    help="What the twins change; may be repeated.  [default: all]",
)
@click.option(
    "--stranger", default=STRANGER, show_default=True, metavar="AGENT", help="Drives one CAV of the stranger twins."
)
@click.option("--limit", type=click.IntRange(min=1), metavar="N", help="Only the first N scenarios.")
@study_options(suite="hard", seed=0, seeds=3)
@setting_option("agent_limits")
@click.pass_context
def twins_command(
    ctx: click.Context,
    agents: tuple[str, ...],
    factors: tuple[str, ...],
    stranger: str,
    limit: int | None,
    **options: Any,
) -> None:
    """Measure what each factor of a scenario costs each agent, by twins in which only this factor changes.

    occluder: what hides a road user is gone; connection: no station sends; background: traffic is gone; weather: a
    clear day; stranger: one CAV has another agent. Writes twins.json, twins.csv, twins-episodes.csv, twins.md and a
    picture into --out, the twins into --out/suites and every run into --out/runs. Twins that cannot be made are listed
    with the reason. The same command given again continues an interrupted study.

    Exit codes: 0 every scenario has a score, 1 some are void or an agent failed, 2 unusable input, 130 interrupted.
    """
    given = StudyOptions(**options)
    chosen = tuple(factor for factor in TwinFactor if not factors or factor in factors)
    names = parse_agent_names(",".join(agents), option="--agent")
    if TwinFactor.STRANGER in chosen and stranger in names:
        raise InputError(f"study: --stranger: expected an agent that is not among --agent, found {stranger!r}")
    if limit is not None:
        first = given.prepare_agent(names[0]).scenarios[:limit]
        given = replace(given, scenario=",".join(scenario.id for scenario in first))
    prepared = {name: given.prepare_agent(name) for name in names}
    given.prepare_agent(stranger)  # an agent that cannot be started is found here
    rows = drive_with_display(ctx, TwinStudy(prepared, chosen, AgentSpec(stranger), given.all_seeds, given.out))
    summary = summarise_twins(rows)
    about = given.describe(rows)
    pictures = draw_twins(summary, rows[0].results[0].run.suite_label, given.out / "twins")
    pages = {
        "twins.json": twins_json(about, stranger, rows, summary),
        "twins.csv": twins_csv(summary),
        "twins-episodes.csv": twin_episodes_csv(summary),
        "twins.md": twins_markdown(about, stranger, rows, summary, pictures[0].name),
    }
    tables = [format_text(build_twins_table(summary))]
    if summary.gaps:
        tables.append(format_text(build_gap_table(summary)))
    given.end_study(ctx, rows, pages, pictures, tables, summary.void)
