"""`mdrive-sumo study human`: a study with persons at the wheel, served, run by scripted drivers, or evaluated."""

import asyncio
import shlex
import webbrowser
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path

import click

from mdrive_sumo.cli.options import get_command_line, workers_option
from mdrive_sumo.cli.study_options import drive_with_display
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.posix import check_posix
from mdrive_sumo.core.private_paths import hide_command
from mdrive_sumo.core.tables import format_text
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.scenario.suite import Suite
from mdrive_sumo.study.human.human_report import build_human_table
from mdrive_sumo.study.human.human_study_folder import STUDY_FILE, HumanStudyFolder
from mdrive_sumo.study.human.plan_file import check_plan, describe_balance, load_plan
from mdrive_sumo.study.human.scripted_driver import DRIVER_KINDS
from mdrive_sumo.study.human.scripted_study import run_scripted_study
from mdrive_sumo.study.human.write_human_results import ComparedAgents, load_human_results, write_human_results
from server.cli.drive_command import DriveServer, ServerPlace, make_config
from server.clock import now_us
from server.drive.drive_app import create_drive_app
from server.drive.drive_host import DriveHost
from server.drive.study.study_drives import HostedDrives
from server.drive.study.study_pages import mount_study
from server.drive.study.study_service import StudyService


@click.command("human")
@click.argument("folder", required=False, type=click.Path(path_type=Path), metavar="[DIR]")
@click.option("--plan", "plan_file", type=click.Path(path_type=Path), metavar="FILE", help="The plan: YAML or JSON.")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="The study's folder, new or continued.")
@click.option(
    "--scripted",
    metavar="KIND,...",
    help=f"Run the whole plan without persons, with programs of these kinds: {', '.join(DRIVER_KINDS)}.",
)
@click.option("--example", is_flag=True, help="Print a plan to begin with, and do nothing else.")
@click.option("--results", is_flag=True, help="Drive the agents of the plan, and write tables, figure and CSV.")
@click.option("--host", default="127.0.0.1", show_default=True, help="Address to listen on.")
@click.option("--port", type=click.IntRange(0, 65535), help="[default: that of `drive`, or a free one]")
@click.option("--public-url", metavar="URL", help="How participants reach this server: through a proxy or a tunnel.")
@click.option("--no-open", is_flag=True, help="Print the organiser's link, open nothing.")
@workers_option
@click.pass_context
def human(
    ctx: click.Context,
    folder: Path | None,
    plan_file: Path | None,
    out: Path | None,
    scripted: str | None,
    example: bool,
    results: bool,
    host: str,
    port: int | None,
    public_url: str | None,
    no_open: bool,
    workers: int,
) -> None:
    """Study persons at the wheel (RQ4).

    With --plan and --out, or with the DIR of a study: serves pages for participants, each with a link, until Ctrl-C;
    the same command continues. With --scripted, programs drive the whole plan instead; they count as no person. With
    --results, writes what was driven beside agents on the same scenarios into DIR/results.

    Exit codes: 0 done, 1 an agent failed or a scenario is void, 2 unusable input, 130 interrupted.
    """
    if example:
        echo(files("server.drive.study").joinpath("examples", "rq4.yaml").read_text("utf-8").rstrip("\n"))
        return
    check_posix("study human: its folder is locked, which")
    kinds = None if scripted is None else [kind.strip() for kind in scripted.split(",") if kind.strip()]
    study, suite = _open_study(folder, plan_file, out, kinds)
    with study.lock():
        if kinds is not None:
            run_scripted_study(study, suite, kinds, echo)
        if results:
            _write_results(ctx, study, suite, workers)
        if kinds is None and not results:
            _serve_study(study, suite, (host, port, public_url), is_browser_wanted=not no_open)


def _open_study(
    folder: Path | None, plan_file: Path | None, out: Path | None, kinds: Sequence[str] | None
) -> tuple[HumanStudyFolder, Suite]:
    """Return the study and its suite. Raises InputError, and click.UsageError for options that do not fit."""
    if (plan_file is None) != (out is None) or (plan_file is None) == (folder is None):
        raise click.UsageError("expected either --plan FILE with --out DIR, or the DIR of a study")
    if plan_file is None:
        assert folder is not None, "one of both is given"
        study = HumanStudyFolder.open_existing(folder)
        if kinds is not None and study.drivers != "scripted":
            raise InputError(f"{folder}: expected a study of scripted drivers, found one of persons")
        return study, check_plan(study.plan, str(folder / STUDY_FILE))
    assert out is not None, "both are given"
    plan = load_plan(plan_file)
    suite = check_plan(plan, str(plan_file))
    if note := describe_balance(plan):
        echo(f"note: {plan_file}: {note}", err=True)
    return HumanStudyFolder.create(out, plan, "persons" if kinds is None else "scripted"), suite


def _write_results(ctx: click.Context, study: HumanStudyFolder, suite: Suite, workers: int) -> None:
    command = hide_command(get_command_line(), study.folder)
    rows = drive_with_display(ctx, ComparedAgents(study, suite, workers, get_command_line()))
    results = load_human_results(study, {row.agent: row.results for row in rows})
    paths = write_human_results(study, results, shlex.join(command))
    echo(format_text(build_human_table(results)))
    echo("\n" + "\n".join(map(str, paths)))
    if any(row.results.void for row in rows):
        ctx.exit(1)


def _serve_study(
    study: HumanStudyFolder, suite: Suite, place: tuple[str, int | None, str | None], *, is_browser_wanted: bool
) -> None:
    """Serve the pages until a signal ends it."""
    if study.drivers != "persons":
        raise InputError(
            f"{study.folder}: expected a study of persons, found one of scripted drivers; --out names another folder"
        )
    asyncio.run(_serve(study, suite, ServerPlace(*place), is_browser_wanted))


async def _serve(study: HumanStudyFolder, suite: Suite, place: ServerPlace, is_browser_wanted: bool) -> None:
    """Serve the pages; what goes on at the end is continued by the same command."""
    host = DriveHost(place.list_names())
    app = create_drive_app(host)
    service = StudyService(study, HostedDrives(host, study, suite), lambda: now_us() // 1_000_000)
    mount_study(app, service)
    server = DriveServer(make_config(app))
    with place.open_listener() as listener:
        url = place.find_url(listener.getsockname()[1])

        def show_link() -> None:
            echo(f"organiser, with the links of all participants: {url}{service.organiser_path}")
            echo(f"study: {study.folder} (Ctrl-C ends the server; the same command continues)", err=True)
            if is_browser_wanted:
                asyncio.get_running_loop().run_in_executor(None, webbrowser.open, url + service.organiser_path)

        server.on_start = show_link
        try:
            await server.serve(sockets=[listener])
        finally:
            await host.close(wait_s=0.0)
    echo(f"stopped; `mdrive-sumo study human {shlex.quote(str(study.folder))}` continues", err=True)
