"""`mdrive-sumo report`."""

from pathlib import Path

import click

from mdrive_sumo.cli.options import get_command_line
from mdrive_sumo.cli.replay_bar import write_run_replays
from mdrive_sumo.core.atomic_folder import check_new_folder
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.private_paths import hide_command
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.comparison_report.compared_agent import make_compared_agents
from mdrive_sumo.report.comparison_report.comparison_report import build_comparison_report
from mdrive_sumo.report.comparison_report.report_runs import load_report_runs
from mdrive_sumo.report.comparison_report.write_comparison_report import write_comparison_report
from mdrive_sumo.report.run_page.replay_files import ReplaySelection
from mdrive_sumo.runs.stored_run import load_viewed_run


@click.command("report")
@click.argument("runs", nargs=-1, required=True, type=click.Path(path_type=Path), metavar="RUN...")
@click.option("--out", required=True, type=click.Path(path_type=Path), metavar="DIR", help="A new or empty folder.")
@click.option("--baseline", default="", metavar="NAME", help="Compare all with this agent, not every pair.")
@click.option("--with-published", is_flag=True, help="Add the paper's CARLA rows to the main table, not ranked.")
@click.option(
    "--replays",
    type=click.Choice([str(selection) for selection in ReplaySelection]),
    default=str(ReplaySelection.NONE),
    show_default=True,
    help="Write replays for the scores to lead to, as `view` does: where something was lost, all, none.",
)
@click.option("--mix-seasons", is_flag=True, help="Runs of an agent in several seasons are one line of a table.")
@click.option("--suite", metavar="NAME|DIR", help="Of --replays: where the runs' suite is now, if it has moved.")
def command(
    runs: tuple[Path, ...],
    out: Path,
    baseline: str,
    with_published: bool,
    replays: str,
    mix_seasons: bool,
    suite: str | None,
) -> None:
    """Write tables and figures over several runs.

    RUN is a folder written by `eval`, or a results file. All runs have one suite, set of scenarios, score mode and
    version. Runs of an agent that differ in their seeds only are one line of a table; those with other settings have
    lines of their own, named by what differs (--baseline takes these names). Runs of several seasons are refused unless
    --mix-seasons is given.

    --out gets report.html (one file, for any browser), report.md, every table as csv/NAME.csv and latex/NAME.tex (for
    \\input, with booktabs), every figure as SVG and PNG. The best three of a column are marked as in the paper;
    privileged agents and published rows are never ranked. Differences are paired by scenario and seed, each with a
    95 % interval; how many remain after a correction for their number is said below.

    A score of a scenario leads to its replay in RUN/view, where `view` or --replays has written one.
    """
    check_new_folder(out)
    agents = make_compared_agents(load_report_runs(runs, mix_seasons=mix_seasons))
    command_line = hide_command(get_command_line(), Path.cwd())
    report = build_comparison_report(agents, baseline=baseline, with_published=with_published, command=command_line)
    _write_replays(runs, ReplaySelection(replays), suite)
    files = write_comparison_report(report, out)
    echo(format_text(report.tables[0]))
    echo("\n" + "\n".join((*(f"note: {warning}" for warning in report.warnings), *map(str, files))))


def _write_replays(places: tuple[Path, ...], selection: ReplaySelection, suite: str | None) -> None:
    """Write the replays of runs into their folders. Raises InputError for a results file: it has no recordings."""
    if selection is ReplaySelection.NONE:
        return
    for place in places:
        if place.is_file():
            raise InputError(f"--replays: expected folders of runs with it, found the file {str(place)!r}")
        write_run_replays(load_viewed_run(place, suite), selection)
