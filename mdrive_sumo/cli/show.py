"""`mdrive-sumo show`."""

from collections.abc import Generator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import click

from mdrive_sumo.cli.evaluate import with_references
from mdrive_sumo.cli.options import workers_option
from mdrive_sumo.cli.stored_run_options import find_one_scenario
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import write_text
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.agent_failures import format_agent_failures
from mdrive_sumo.report.result_tables import format_summary
from mdrive_sumo.report.run_report import build_run_report
from mdrive_sumo.report.scenario_plot import save_network_plot, save_scenario_plot
from mdrive_sumo.roads import find_network_folder, load_road_map
from mdrive_sumo.roads.network_file import NETWORK_FILE
from mdrive_sumo.runs.evaluate import RESULTS_FILE, report_write_errors
from mdrive_sumo.runs.journal import JOURNAL_FILE
from mdrive_sumo.runs.run_folder import check_run_folder
from mdrive_sumo.runs.stored_run import load_stored_run
from mdrive_sumo.scenario.suite import load_suite
from mdrive_sumo.study.certified_failures import build_failure_table
from mdrive_sumo.study.need_certificate import NeedCertificateFile

CERTIFIED_LEGEND = (
    "drives of CAVs of which a certificate of need proves something (docs/hard-certificates.md), by how they end:\n"
    "certified conflict: the first costly infraction is a collision in a conflict that the certificate names, with\n"
    "the road user that it names or with another one of the same stream;\n"
    "late: no costly infraction, but it does not arrive; elsewhere: another infraction is the first"
)


@click.command("show")
@click.argument("whats", metavar="SCENARIO...|RUN|NETWORKS", nargs=-1, required=True)
@click.option(
    "--suite", metavar="NAME|DIR", help="Packaged suite, or a suite's folder [default: interdrive, the run's]."
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture of a scenario [default: SCENARIO.png], or report of a run in Markdown [default: none].",
)
@click.option("--captured", is_flag=True, help="Of a run: captured cooperation; drives its references if need be.")
@workers_option
@click.pass_context
def command(
    ctx: click.Context, whats: tuple[str, ...], suite: str | None, out: Path | None, captured: bool, workers: int
) -> None:
    """Draw a scenario or a network, or print the table of a finished run.

    A drawn SCENARIO shows network, buildings, signs, CAVs with routes and goals, and background traffic. It is
    an id, or a glob that fits exactly one; several are drawn into a picture each. The ending of --out (.png, .svg,
    .pdf) is the format.

    NETWORKS is a network's folder (with network.json), or a folder with networks/, such as `convert opendrive` writes;
    each network is drawn.

    RUN is a folder that `eval` has written. --captured compares it with the same agent without a channel and
    with omniscient, which are looked for in their default folders below runs/, and driven if they are not there.
    With a suite that has certificates of need, a table says how often CAVs fail as those prove.
    """
    if len(whats) > 1:
        if captured or out is not None:
            raise click.UsageError(f"--out and --captured: expected one SCENARIO or RUN with them, found {len(whats)}")
        for pattern in whats:
            _show_scenario(pattern, suite or "interdrive", None)
        return
    what = "".join(whats)  # the only one
    folder = Path(what)
    if (folder / RESULTS_FILE).is_file():
        _show_run(ctx, folder, suite, out, workers if captured else 0)
    elif captured:
        raise InputError(f"show --captured: expected the folder of a finished run, found {what!r}")
    elif networks := _find_networks(folder):
        _show_networks(networks, out)
    elif (folder / JOURNAL_FILE).is_file() or len(folder.parts) > 1:
        check_run_folder(folder)
    else:
        _show_scenario(what, suite or "interdrive", out)


def _show_run(ctx: click.Context, folder: Path, suite: str | None, out: Path | None, workers: int) -> None:
    """workers: for the references of captured cooperation; 0: without it."""
    stored = load_stored_run(folder, suite)
    run, results = stored.run, stored.results
    if workers and (changed := stored.describe_version_changes()):
        echo(f"warning: the run was made with another {changed} than its references", err=True)
    config = replace(run.config, suite=suite or run.config.suite, workers=workers)
    shares = with_references(ctx, results, config) if workers else None
    echo(format_summary(results, shares))
    if failures := format_agent_failures(results, folder):
        echo("\n" + failures)
    certified = build_failure_table(results.scenarios, NeedCertificateFile.load(run.suite), run.suite.scenarios)
    if certified is not None:
        echo(f"\n{format_text(certified)}\n\n{CERTIFIED_LEGEND}")
    if out is not None:
        with report_write_errors(out):
            write_text(out, build_run_report(results, shares))
        echo(f"\n{out}")


def _find_networks(folder: Path) -> list[Path]:
    """Return the folders of the networks that a folder is or has."""
    found = [folder, *sorted((folder / "networks").glob("*"))]
    return [place for place in found if (place / NETWORK_FILE).is_file()]


def _show_networks(networks: Sequence[Path], out: Path | None) -> None:
    if out is not None and len(networks) > 1:
        raise click.UsageError(f"--out: expected one network with it, found {len(networks)}")
    for folder in networks:
        path = out or Path(f"{folder.resolve().name}.png")
        with _report_picture_errors(path):
            save_network_plot(load_road_map(folder), path)
        echo(path)


@contextmanager
def _report_picture_errors(path: Path) -> Generator[None]:
    try:
        yield
    except (OSError, ValueError) as error:  # ValueError: matplotlib does not know the ending
        raise InputError(f"{path}: cannot be written: {error}") from None


def _show_scenario(pattern: str, suite: str, out: Path | None) -> None:
    loaded = load_suite(suite)
    chosen = find_one_scenario(loaded, pattern)
    path = out or Path(f"{chosen.id}.png")
    roads = load_road_map(find_network_folder(chosen.network, beside=loaded.find_folder(chosen.id)))
    with _report_picture_errors(path):
        save_scenario_plot(chosen, roads, path)
    echo(path)
