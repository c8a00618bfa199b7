"""`mdrive-sumo verify`."""

from pathlib import Path
from typing import Any

import click

from mdrive_sumo.api.verification import FileVerification, RunVerification
from mdrive_sumo.cli.options import workers_option
from mdrive_sumo.cli.stored_run_options import foreign_agent_options, moved_suite_option, read_permission
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.runs.foreign_agent import describe_foreign_agent
from mdrive_sumo.runs.prepared_run import PreparedRun
from mdrive_sumo.runs.stored_run import StoredRun, load_unchecked_run

MAX_DIFFERENCES = 20
"""Differences of a file that are listed; the others are counted."""


@click.command("verify")
@click.argument("run_folder", metavar="RUN", type=click.Path(path_type=Path))
@click.option("--sample", type=click.IntRange(min=1), metavar="N", help="Only N scenarios, always the same ones.")
@moved_suite_option
@foreign_agent_options
@workers_option
@click.pass_context
def command(
    ctx: click.Context, run_folder: Path, sample: int | None, suite: str | None, workers: int, **options: Any
) -> None:
    """Execute the scenarios of a run again, and compare every tick and every number with what RUN holds.

    Names the first tick that differs and what differs in it, and every number in results.json, results-MODE.json,
    journal.jsonl and report.md that is not the score of the second execution. Failures of agents are replayed from
    the recording, because a time-out is not reproducible. Without recordings only final digests are compared.

    A third-party agent's code comes with the run. It runs only with --trust-agent or in boxes; on a terminal you are
    asked. An agent that has changed since the run is refused.

    Exit codes: 0 all identical, 1 something differs, 2 unusable input.
    """
    stored = load_unchecked_run(run_folder, suite)
    verification = RunVerification(stored, read_permission(options), sample)
    _print_circumstances(stored, verification.run)
    different = 0
    for verdict in verification.verify_episodes(workers):
        replayed = f"; taken from the recording: {verdict.replayed}" if verdict.replayed else ""
        echo(f"{verdict.scenario}: {verdict.text}{replayed}")
        different += not verdict.identical
    files = list(verification.verify_files())
    for file in files:
        _print_file(file)
    total = len(verification.chosen)
    skipped = f", {void} void" if (void := sum(one.status == "void" for one in stored.results.scenarios)) else ""
    numbers = sum(len(file.differences) for file in files)
    also = f"; the files of the run have {numbers} other values" if numbers else ""
    echo(f"{total - different} of {total} scenarios are identical{skipped}{also}")
    ctx.exit(1 if different or numbers else 0)


def _print_circumstances(stored: StoredRun, run: PreparedRun) -> None:
    """Print warnings, and which third-party code runs."""
    if changed := stored.describe_version_changes():
        echo(f"warning: the run was made with another {changed}", err=True)
    if not run.config.record:
        echo("warning: the run has no recordings; only final digests are compared", err=True)
    if not stored.journal.checksum:
        echo("warning: the journal is of an older version, whose lines have no checksums", err=True)
    where = "in boxes" if run.config.sandbox else "with your permissions"
    for agent in run.config.agents:
        if not agent.is_builtin:
            echo(f"running {describe_foreign_agent(agent)} {where}", err=True)


def _print_file(file: FileVerification) -> None:
    left_out = f" (not compared: {file.left_out})" if file.left_out else ""
    if not file.differences:
        echo(f"{file.file}: every number as expected{left_out}")
        return
    for difference in file.differences[:MAX_DIFFERENCES]:
        echo(f"{file.file}: {difference}")
    if len(file.differences) > MAX_DIFFERENCES:
        echo(f"{file.file}: and {len(file.differences) - MAX_DIFFERENCES} more differences")
