"""`mdrive-sumo admin`: teams, tokens, phases, environments, backups."""

import json
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.output_files import make_folder
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.scenario.season import read_stored_name
from server import environments
from server.cli.data_folder import find_database_file
from server.cli.options import data_option, load_settings_with, report_store_errors, settings_option
from server.cli.phase_season import draw_phase
from server.clock import format_utc, now_us
from server.enums import TokenScope
from server.evaluation import spot_checks
from server.settings import ServerSettings
from server.store import Store, audit, phases, retention, standings, teams, tokens
from server.store.backup import restore_backup as read_backup
from server.store.backup import write_backup as write_backup
from server.store.row_check import find_row_differences


class _AdminContext:
    """The settings and the database, which is opened only when a command uses it: help and validation write nothing."""

    def __init__(self, ctx: click.Context, settings: ServerSettings) -> None:
        self.settings = settings
        self._ctx = ctx

    @cached_property
    def store(self) -> Store:
        """The database of the challenge, migrated. Raises InputError if it does not exist."""
        file = find_database_file(self.settings)
        if file is not None and not file.exists():
            raise InputError(
                f"database: expected one at {file}, found none; --data or --settings says where it is, and"
                " `mdrive-sumo serve` or `mdrive-sumo admin team create NAME` makes a new one"
            )
        return self.begin()

    def begin(self, migrate: bool = True) -> Store:
        """Open the database; make it if it does not exist."""
        store = Store(self.settings.database_url)
        self._ctx.call_on_close(store.close)
        if migrate:
            with report_store_errors():
                store.migrate()
        return store


_pass_admin = click.make_pass_decorator(_AdminContext)


@click.group("admin")
@settings_option
@data_option
@click.pass_context
def admin(ctx: click.Context, file: Path | None, data: Path | None) -> None:
    """Administer a challenge: teams, tokens, phases, environments, backups. The server may be running."""
    ctx.obj = _AdminContext(ctx, load_settings_with(file, data))


@admin.group()
def team() -> None:
    """Manage teams."""


@team.command("create")
@click.argument("name")
@_pass_admin
def create_team(admin_context: _AdminContext, name: str) -> None:
    """Create a team and print its token, which is shown only once."""
    teams.check_name(name)
    with report_store_errors(), admin_context.begin().write() as session:
        text = tokens.issue(session, teams.create(session, name, now_us()), TokenScope.SUBMIT, now_us())
    echo(text)


@team.command("list")
@_pass_admin
def list_teams(admin_context: _AdminContext) -> None:
    """List teams: id, name, time of creation."""
    with report_store_errors(), admin_context.store.read() as session:
        for each in teams.list_teams(session):
            echo(f"{each.id}  {each.name}  {format_utc(each.created_us)}{'  hidden' if each.hidden else ''}")


@team.command("hide")
@click.argument("name")
@click.option("--show", is_flag=True, help="Show it again instead.")
@_pass_admin
def hide_team(admin_context: _AdminContext, name: str, show: bool) -> None:
    """Hide a team (name or id) from the leaderboards."""
    with report_store_errors(), admin_context.store.write() as session:
        teams.set_hidden(session, teams.get(session, name).id, not show, now_us())


@admin.group()
def token() -> None:
    """Manage tokens of clients."""


@token.command("issue")
@click.option("--team", "name", help="Team (name or id), for the scope submit.")
@click.option("--scope", type=click.Choice([scope.value for scope in TokenScope]), default="submit", show_default=True)
@_pass_admin
def issue_token(admin_context: _AdminContext, name: str | None, scope: str) -> None:
    """Issue and print a token, which is shown only once."""
    begins = name is None and scope != TokenScope.SUBMIT
    store = admin_context.begin() if begins else admin_context.store
    with report_store_errors(), store.write() as session:
        holder = teams.get(session, name) if name is not None else None
        text = tokens.issue(session, holder, TokenScope(scope), now_us())
    echo(text)


@token.command("list")
@click.option("--team", "name", help="Team (name or id) [default: tokens of admins and workers].")
@_pass_admin
def list_tokens(admin_context: _AdminContext, name: str | None) -> None:
    """List tokens: id, scope, time of issue; never the token itself."""
    with report_store_errors(), admin_context.store.read() as session:
        for each in tokens.list_tokens(session, teams.get(session, name) if name is not None else None):
            end = f"  revoked {format_utc(each.revoked_us)}" if each.revoked_us is not None else ""
            echo(f"{each.id}  {each.scope}  {format_utc(each.created_us)}{end}")


@token.command("revoke")
@click.argument("token_id")
@_pass_admin
def revoke_token(admin_context: _AdminContext, token_id: str) -> None:
    """Revoke a token."""
    with report_store_errors(), admin_context.store.write() as session:
        tokens.revoke(session, token_id, now_us())


@admin.group()
def phase() -> None:
    """Manage phases, which are defined in the settings file."""


@phase.command("list")
@_pass_admin
def list_phases(admin_context: _AdminContext) -> None:
    """List the phases in the database."""
    with report_store_errors(), admin_context.store.read() as session:
        for each in phases.list_phases(session):
            kind = "public" if each.public else "hidden"
            period = f"{format_utc(each.opens_us)} - {format_utc(each.closes_us)}"
            echo(f"{each.id}  {kind}  {period}  {read_stored_name(each.suite)}")


@phase.command("apply")
@_pass_admin
def apply_phases(admin_context: _AdminContext) -> None:
    """Apply the phases of the settings without a restart."""
    if not admin_context.settings.phases:
        raise InputError("phase apply: expected settings with phases, found none; give --settings")
    with report_store_errors(), admin_context.begin().write() as session:
        phases.set_phases(session, [each.as_new() for each in admin_context.settings.phases], now_us())
        standings.refresh_scores(session)


phase.add_command(draw_phase)


@admin.group()
def environment() -> None:
    """Manage the environments of agents."""


@environment.command("list")
@_pass_admin
def list_environments(admin_context: _AdminContext) -> None:
    """List environments and whether they are built."""
    built = environments.list_built(admin_context.settings.environments)
    for name in environments.RECIPES:
        echo(f"{name}  {'built' if name in built else 'not built'}")


@environment.command("build", context_settings={"ignore_unknown_options": True})
@click.argument("name")
@click.option(
    "--wheels",
    type=click.Path(path_type=Path, exists=True, file_okay=False, resolve_path=True),
    help="Folder of wheels from which alone everything is installed, without a network [default: pip's index].",
)
@click.argument("pip_options", nargs=-1, type=click.UNPROCESSED)
@_pass_admin
def build_environment(admin_context: _AdminContext, name: str, wheels: Path | None, pip_options: Sequence[str]) -> None:
    """Build an environment with venv and pip; options after NAME go to pip (docs/server-environments.md)."""
    folder = admin_context.settings.environments.absolute()
    environments.find_recipe(name)
    make_folder(folder)
    built = environments.build_environment(name, folder, pip_options, wheels)
    echo(f"{built.name}  {len(built.packages)} packages  {built.python}")


@environment.command("import")
@click.argument("name")
@click.argument("rootfs", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--python", default=environments.IMAGE_PYTHON, show_default=True, help="Path of the interpreter in the image."
)
@_pass_admin
def import_environment(admin_context: _AdminContext, name: str, rootfs: Path, python: str) -> None:
    """Register an unpacked image as an environment; the folder is not copied (docs/docker.md)."""
    folder = admin_context.settings.environments.absolute()
    made = environments.import_image(name, folder, rootfs, python, admin_context.settings.sandbox.box_limits())
    echo(f"{made.name}  {len(made.packages)} packages  {made.rootfs}")


@admin.command()
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@_pass_admin
def backup(admin_context: _AdminContext, file: Path) -> None:
    """Write all tables to a new file and print the head of the audit log; store it elsewhere."""
    with report_store_errors():
        echo(write_backup(admin_context.store, file))


@admin.command()
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@_pass_admin
def restore(admin_context: _AdminContext, file: Path) -> None:
    """Fill an empty database from a backup and print the head of its audit log. Stop `serve` first."""
    with report_store_errors():
        echo(read_backup(admin_context.begin(migrate=False), file))


@admin.command("audit")
@click.option(
    "--list",
    "most",
    type=click.IntRange(1),
    is_flag=False,
    flag_value=20,
    help="Print that many entries, by default 20.",
)
@_pass_admin
@click.pass_context
def walk(ctx: click.Context, admin_context: _AdminContext, most: int | None) -> None:
    """Verify the audit log, and compare all rows with it.

    Exit code 1 if an entry was changed, inserted or removed, or if a team, token, phase, submission, result or
    leaderboard is not as the log says. With --list the latest entries are printed first: time, actor, action, data.
    """
    with report_store_errors(), admin_context.store.read() as session:
        for entry in reversed(audit.list_latest(session, most or 0)):
            echo(f"{format_utc(entry.at_us)}  {entry.actor}  {entry.action}  {json.dumps(entry.data, sort_keys=True)}")
        chain = audit.verify_chain(session)
        differences = list(find_row_differences(session)) if chain.broken is None else []
    echo(f"{chain.entries} entries, head {chain.head or 'none'}")
    if chain.broken is not None:
        echo(f"broken at entry {chain.broken}", err=True)
    for difference in differences:
        echo(str(difference), err=True)
    if chain.broken is not None or differences:
        ctx.exit(1)


@admin.command()
@_pass_admin
def collect(admin_context: _AdminContext) -> None:
    """Delete archives and recordings whose retention ([keep] of the settings) is over."""
    with report_store_errors():
        with admin_context.store.read() as session:
            kept = retention.select_retained(session, admin_context.settings.keep.policy(), now_us())
        for path in retention.delete_expired(kept, admin_context.settings.data, now_us()):
            echo(path)


@admin.command()
@click.argument("submissions", nargs=-1)
@click.option(
    "--latest",
    type=click.IntRange(1, 1000),
    default=10,
    show_default=True,
    help="Number of submissions if none is named.",
)
@_pass_admin
@click.pass_context
def verify(ctx: click.Context, admin_context: _AdminContext, submissions: Sequence[str], latest: int) -> None:
    """Run a sample of finished submissions again and compare. Exit code 1 if something differs."""
    from server.evaluation.submission_job import (
        run_submission_job,  # imported here: no other command needs SUMO
    )

    with report_store_errors():
        with admin_context.store.read() as session:
            chosen = submissions or spot_checks.list_finished(session, latest)
        checks = list(
            spot_checks.run_spot_checks(admin_context.store, admin_context.settings, chosen, now_us, run_submission_job)
        )
    for check in checks:
        echo(f"{check.submission}  {check.scenario} {check.seed}  {check.text}")
    if any(not check.same for check in checks):
        ctx.exit(1)
