"""`mdrive-sumo study gain`: what sharing gains, and by what."""

from typing import Any

import click

from mdrive_sumo.cli.study_display import drive_with_display
from mdrive_sumo.cli.study_options import StudyOptions, study_options
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.study.gain import AGENTS, GainStudy, summarise_gain
from mdrive_sumo.study.gain_files import build_gain_table, gain_csv, gain_json, gain_markdown


@click.command("gain")
@study_options(suite="mdrive", seed=1, seeds=5)
@click.pass_context
def command(ctx: click.Context, **options: Any) -> None:
    """Split the gain of sharing into occlusion, noise and intent.

    Drives single, sharing and sharing+negotiation under both sensing profiles. Writes gain.json, gain.csv and
    gain.md into --out, and every run into --out/runs. The same command given again continues an interrupted study.

    Exit codes: 0 every scenario has a score, 1 some are void or an agent failed, 2 unusable input, 130 interrupted.
    """
    given = StudyOptions(**options, agent_limits=None)  # its agents are built in, and have no limits
    study = GainStudy({name: given.prepare_agent(name) for name in AGENTS}, given.all_seeds, given.out)
    rows = drive_with_display(ctx, study)
    summary = summarise_gain(rows)
    about = given.describe(rows)
    pages = {
        "gain.json": gain_json(about, rows, summary),
        "gain.csv": gain_csv(summary),
        "gain.md": gain_markdown(about, rows, summary),
    }
    table = format_text(build_gain_table(summary))
    results = (one for row in rows for one in row.results)
    given.end_study(ctx, results, pages, (), [table], summary.void)
