"""`mdrive-sumo verify`."""

from pathlib import Path

import click

from mdrive_sumo.cli.workers import workers_option
from mdrive_sumo.runs.stored_run import load_stored_run
from mdrive_sumo.runs.verify import sample_results, verify


@click.command("verify")
@click.argument("run_folder", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--sample", type=click.IntRange(min=1), metavar="N", help="Only N scenarios, always the same ones.")
@click.option("--suite", metavar="NAME|DIR", help="Where the run's suite is now, if it has moved.")
@workers_option
@click.pass_context
def command(ctx: click.Context, run_folder: Path, sample: int | None, suite: str | None, workers: int) -> None:
    """Execute the scenarios of a run again and compare the digest of every tick.

    Names the first tick that differs and what differs in it. Failures of agents are replayed from the
    recording, because a time-out is not reproducible. Without recordings only final digests are compared.

    Exit codes: 0 all identical, 1 something differs, 2 unusable input.
    """
    stored = load_stored_run(run_folder, suite)
    run, results = stored.run, stored.results
    if changed := stored.describe_version_changes():
        click.echo(f"warning: the run was made with another {changed}", err=True)
    if not run.config.record:
        click.echo("warning: the run has no recordings; only final digests are compared", err=True)
    chosen = sample_results(results, sample)
    different = 0
    for verdict in verify(run, chosen, workers):
        click.echo(f"{verdict.scenario}: {verdict.text}")
        different += not verdict.identical
    skipped = f", {results.void} void" if results.void else ""
    click.echo(f"{len(chosen) - different} of {len(chosen)} scenarios are identical{skipped}")
    ctx.exit(1 if different else 0)
