"""`mdrive-sumo submit`: submit an agent and follow it, or run it locally."""

import sys
from pathlib import Path

import click

from mdrive_sumo.cli.options import make_scenario_option, workers_option
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from server.archive import ArchiveLimits, Manifest
from server.enums import ChallengeTrack, SubmissionState
from server.participant.check import choose_environment, environments_option
from server.participant.client import ChallengeClient, SubmissionForm
from server.participant.dry_run import DryRunOptions, dry_run
from server.participant.follow import follow
from server.participant.packaging import open_as_archive, unpack_agent
from server.tracks import check_style

TRACKS = tuple(track.value for track in ChallengeTrack)
UNLIMITED = ArchiveLimits(archive_bytes=2**40, unpacked_bytes=2**40, entries=10**6, ratio=10**6)
"""Only the server's own limits count for a submission."""


@click.command("submit")
@click.argument("path", metavar="DIR|team.zip", type=click.Path(path_type=Path))
@click.option("--server", envvar="MDRIVE_SERVER", metavar="URL", help="Address of the server; also MDRIVE_SERVER.")
@click.option("--token", envvar="MDRIVE_TOKEN", metavar="T", help="Token of your team; preferably in MDRIVE_TOKEN.")
@click.option("--phase", metavar="ID", help="Phase of the challenge [default: the open public one].")
@click.option("--track", type=click.Choice(TRACKS), help="Track [default: joint for joint agents, else single-agent].")
@click.option("--name", metavar="TEXT", help="Name of the method [default: name of DIR or of the archive].")
@click.option("--no-follow", is_flag=True, help="Submit without following.")
@click.option(
    "--dry-run", "dry", is_flag=True, help="Submit nothing: run the agent here, in sandboxes like a server's."
)
@click.option("--suite", default="interdrive", show_default=True, metavar="NAME|DIR", help="For --dry-run.")
@make_scenario_option("For --dry-run: scenario id or category; may be repeated.")
@click.option("--seed", type=click.IntRange(0, 2**31 - 1), default=0, show_default=True, help="For --dry-run.")
@click.option("--out", type=click.Path(path_type=Path), default=Path("runs/dry-run"), show_default=True, metavar="DIR")
@environments_option
@workers_option
@click.pass_context
def submit(
    ctx: click.Context, path: Path, dry: bool, environments: Path | None, no_follow: bool, **options: object
) -> None:
    """Submit an agent to a challenge and follow it, or test it first with --dry-run.

    A folder is packed. Ctrl-C while following does not cancel the submission.

    Exit codes: 0 every scenario has a score, 1 it ended otherwise, 2 unusable input or rejected, 130 interrupted.
    """
    if dry:
        chosen = {name: options[name] for name in ("suite", "scenario", "seed", "workers", "out")}
        course = DryRunOptions(**chosen)  # pyright: ignore[reportArgumentType] - click has converted them to the fields' types
        with unpack_agent(path) as unpacked:
            track = _choose_track(unpacked.manifest, options)
            code = 0 if dry_run(unpacked, choose_environment(unpacked.manifest, environments), track, course) else 1
    else:
        server, token = _require_option(options, "server"), _require_option(options, "token")
        with open_as_archive(path, UNLIMITED) as (archive, manifest), ChallengeClient(server, token) as client:
            code = _send(client, archive, _make_form(client, manifest, path, options), no_follow)
    ctx.exit(code)


def _require_option(options: dict[str, object], name: str) -> str:
    value = options[name]
    if not value:
        raise InputError(f"submit: expected --{name} or MDRIVE_{name.upper()}, found neither; or use --dry-run")
    return str(value)


def _make_form(client: ChallengeClient, manifest: Manifest, path: Path, options: dict[str, object]) -> SubmissionForm:
    return SubmissionForm(
        phase=str(options["phase"] or client.open_phase()),
        track=_choose_track(manifest, options),
        name=str(options["name"] or (path.resolve().name if path.is_dir() else path.stem)),
    )


def _choose_track(manifest: Manifest, options: dict[str, object]) -> ChallengeTrack:
    """Return the chosen or default track. Raises InputError if the agent's style is not allowed in it."""
    chosen = options["track"]
    track = ChallengeTrack(chosen) if isinstance(chosen, str) else manifest.track_hint or ChallengeTrack.SINGLE
    check_style(manifest.style, track)
    return track


def _send(client: ChallengeClient, archive: Path, entry: SubmissionForm, no_follow: bool) -> int:
    """Upload and follow the submission; return the exit code."""
    size = archive.stat().st_size
    with click.progressbar(length=size, label="uploading", file=sys.stderr, width=30) as bar:

        def move(sent: int) -> None:
            bar.update(sent - bar.pos)

        shown = client.submit(archive, entry, move)
    submission, queue = str(shown.get("id", "")), shown.get("queue")
    position = f", position {queue['position']} in the queue" if queue else ""
    echo(f"submission {submission} in {entry.phase}, track {entry.track}: {shown.get('state')}{position}")
    echo(f"page: {client.page(submission)}")
    if no_follow:
        return 0
    return {SubmissionState.DONE: 0, SubmissionState.REJECTED: 2}.get(follow(client, submission, echo), 1)
