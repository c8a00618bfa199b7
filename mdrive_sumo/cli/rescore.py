"""`mdrive-sumo rescore`."""

from pathlib import Path

import click

from mdrive_sumo.cli.setting_options import setting_option
from mdrive_sumo.cli.stored_run_options import moved_suite_option
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.result_tables import format_summary
from mdrive_sumo.runs.rescore import rescore_run, save_rescored
from mdrive_sumo.runs.stored_run import load_stored_run
from mdrive_sumo.scoring import ScoreMode


@click.command("rescore")
@click.argument("run_folder", metavar="RUN", type=click.Path(path_type=Path))
@setting_option("score_mode", help="[default: that of the run]")
@moved_suite_option
@click.pass_context
def command(ctx: click.Context, run_folder: Path, score_mode: str | None, suite: str | None) -> None:
    """Score the recordings of a run again, without simulation, and write RUN/results-MODE.json.

    Exit codes: 0 done, 1 some scenarios are void, 2 unusable input.
    """
    stored = load_stored_run(run_folder, suite)
    again = rescore_run(stored, ScoreMode(score_mode or stored.results.run.score_mode))
    path = save_rescored(stored.run, again)
    echo(format_summary(again))
    echo(f"\n{path}")
    ctx.exit(1 if again.void else 0)
