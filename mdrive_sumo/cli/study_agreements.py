"""`mdrive-sumo study agreements`: how often CAVs that talk hold the same agreement."""

from pathlib import Path

import click

from mdrive_sumo.cli.stored_run_options import moved_suite_option
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.tables import format_csv, format_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.runs.stored_run import load_stored_run
from mdrive_sumo.study.agreements import build_agreement_table, measure_agreements


@click.command("agreements")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@click.option("--scenario", "patterns", multiple=True, metavar="GLOB", help="Only these; repeatable [default: all].")
@click.option("--out", type=click.Path(path_type=Path, dir_okay=False), metavar="FILE", help="The table as CSV.")
@moved_suite_option
def agreements_command(runs: tuple[Path, ...], patterns: tuple[str, ...], out: Path | None, suite: str | None) -> None:
    """Measure how consistent the agreements of recorded runs are, by parties and by density of the background.

    RUN is a folder written by `eval` with an agent that talks, such as `colmdriver`; nothing is driven again. An
    agreement is consistent if a second after it all members hold the same order of passing, and say that they can keep
    to it. Those by the rule or an endpoint have no order, and are not. Members that end before are not asked.

    Exit codes: 0 done, 2 unusable input.
    """
    loaded = [(folder, load_stored_run(folder, suite)) for folder in runs]
    table = build_agreement_table(measure_agreements(loaded, patterns, lambda name: echo(name, err=True)))
    if out is not None:
        write_text(out, format_csv(table))
    echo(format_text(table))
