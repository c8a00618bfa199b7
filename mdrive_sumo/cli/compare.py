"""`mdrive-sumo compare`."""

from pathlib import Path

import click

from mdrive_sumo.core.terminal import echo
from mdrive_sumo.runs.compare import compare, comparison_table
from mdrive_sumo.runs.run_folder import load_run_results
from mdrive_sumo.scoring import load_results


@click.command("compare")
@click.argument("run_a", type=click.Path(path_type=Path))
@click.argument("run_b", type=click.Path(path_type=Path))
@click.option("--mix-seasons", is_flag=True, help="Compare runs of two seasons, by scenarios of the same id.")
def command(run_a: Path, run_b: Path, mix_seasons: bool) -> None:
    """Compare two runs scenario by scenario: B minus A.

    Mean paired differences of DS, SR, efficient SR and time ratio come with 95 % bootstrap confidence intervals: places
    are drawn anew, then the scenarios of each; seeds count as their mean. Those of the time ratio are over the
    scenarios in which every CAV arrives in both runs. RUN_A and RUN_B are folders written by `eval`, or results files.
    Settings that differ are listed. Of a run that is going on or was interrupted the finished episodes are compared.
    Runs of two seasons are refused unless --mix-seasons is given; `study seasons` has their means.
    """
    a, b = (load_results(run) if run.is_file() else load_run_results(run) for run in (run_a, run_b))
    echo(comparison_table(compare(a, b, (run_a, run_b), mix_seasons=mix_seasons)))
