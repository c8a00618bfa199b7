"""`mdrive-sumo study attacks`: what lying senders cost, and what a defence is worth."""

from collections.abc import Sequence
from typing import Any

import click

from mdrive_sumo.agents.registry import DEFENDED_AGENTS
from mdrive_sumo.cli.setting_options import setting_option
from mdrive_sumo.cli.study_options import StudyOptions, drive_with_display, parse_agent_names, study_options
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.runs.other_agents import SINGLE
from mdrive_sumo.study.attacks import ATTACKS, UNDEFENDED, AttackedAgent, AttackStudy, summarise_attacks
from mdrive_sumo.study.attacks_files import attacks_csv, attacks_json, attacks_markdown, build_attacks_table
from mdrive_sumo.v2x.attacks.attack_settings import parse_attack


@click.command("attacks")
@click.option(
    "--agents",
    default=",".join(DEFENDED_AGENTS),
    show_default=True,
    metavar="A,B,...",
    help="Agents, each as --agent of `eval`; those with a defence are driven with and without it.",
)
@click.option("--alone", default=SINGLE, show_default=True, metavar="AGENT", help="The agent beside which they stand.")
@click.option(
    "--attack",
    "attacks",
    multiple=True,
    metavar="KIND[:OPTION=VALUE,...]",
    help="An attack, as --attack of `eval`; may be repeated [default: every kind, by one CAV].",
)
@study_options(suite="hard", seed=1, seeds=3)
@setting_option("agent_limits")
@click.pass_context
def attacks_command(ctx: click.Context, agents: str, alone: str, attacks: tuple[str, ...], **options: Any) -> None:
    """Measure what lying senders cost: DS under each attack, with and without a defence, beside an agent alone.

    Writes attacks.json, .csv and .md into --out, and every run into --out/runs. The same command given again continues
    an interrupted study.

    Exit codes: 0 every scenario has a score, 1 some are void or an agent failed, 2 unusable input, 130 interrupted.
    """
    given = StudyOptions(**options)
    names = parse_agent_names(agents)
    if alone in names:
        raise InputError(f"study: --alone: expected an agent that is not among --agents, found {alone!r}")
    study = AttackStudy(
        AttackedAgent(alone, None, given.prepare_agent(alone)),
        tuple(one for name in names for one in _prepare_agents(given, name)),
        _parse_attacks(attacks),
        given.all_seeds,
        given.out,
    )
    study.check()
    rows = drive_with_display(ctx, study)
    summary = summarise_attacks(rows)
    about = given.describe(rows)
    pages = {
        "attacks.json": attacks_json(about, rows, summary),
        "attacks.csv": attacks_csv(summary),
        "attacks.md": attacks_markdown(about, rows, summary),
    }
    given.end_study(ctx, rows, pages, (), [format_text(build_attacks_table(summary))], summary.void)


def _prepare_agents(given: StudyOptions, name: str) -> Sequence[AttackedAgent]:
    """Return an agent, and if it has a defence also the agent without it. Raises InputError."""
    if name not in DEFENDED_AGENTS:
        return (AttackedAgent(name, None, given.prepare_agent(name)),)
    return (
        AttackedAgent(name, True, given.prepare_agent(name)),
        AttackedAgent(name, False, given.prepare_agent(name, UNDEFENDED)),
    )


def _parse_attacks(texts: Sequence[str]) -> tuple[str, ...]:
    """Return the attacks in their canonical form. Raises InputError for none, a bad one, and one twice."""
    parsed = [parse_attack(text) for text in texts or ATTACKS]
    names = [attack.text for attack in parsed if attack is not None]
    if len(names) < len(parsed) or len(set(names)) < len(names):
        raise InputError(f"study: --attack: expected different attacks, found {', '.join(texts)}")
    return tuple(names)
