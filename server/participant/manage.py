"""`mdrive-sumo results` and `mdrive-sumo cancel`: look at submissions on a server, and cancel them."""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeVar

import click

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.tables import format_text, make_text_table
from mdrive_sumo.core.terminal import echo
from server.enums import SubmissionState
from server.participant.client import ChallengeClient
from server.participant.follow import SCORES, follow, format_state, print_summary

_ID = re.compile(r"(?:.*/)?([0-9a-f]{32})/?")
"""An id, or the address of a submission's page."""
_Command = TypeVar("_Command", bound=Callable[..., Any])


def server_options(command: _Command) -> _Command:
    """Add the options that name a server and a token."""
    token = click.option("--token", envvar="MDRIVE_TOKEN", metavar="T", help="Token of your team; also MDRIVE_TOKEN.")
    server = click.option("--server", envvar="MDRIVE_SERVER", metavar="URL", help="Its address; also MDRIVE_SERVER.")
    return server(token(command))


@click.command("results")
@click.argument("submission", metavar="[ID|URL]", required=False)
@server_options
@click.option("--csv", "file", type=click.Path(path_type=Path, dir_okay=False), help="Write the scenarios to a file.")
@click.option("--follow", "wait", is_flag=True, help="Wait for the end of the submission first.")
@click.pass_context
def results(
    ctx: click.Context, submission: str | None, server: str | None, token: str | None, file: Path | None, wait: bool
) -> None:
    """Show the result of a submission with its scenarios, the worst ones first; without ID, list your submissions.

    Of a hidden phase it shows the rounded scores of the whole suite.

    Exit codes: 0 done or still running, 1 it ended otherwise, 2 unusable input.
    """
    if submission is None and (file is not None or wait):
        raise InputError("results: expected the ID of a submission with --csv and --follow, found none")
    with open_client(server, token) as client:
        if submission is None:
            echo(_format_list(client.list_submissions()))
            return
        id_ = parse_id(submission)
        if wait:
            follow(client, id_, echo)
        state = _print_result(client, id_)
        if file is not None:
            _write_new(file, client.scenarios_csv(id_))
            echo(f"scenarios: {file}")
    unfinished = (SubmissionState.QUEUED, SubmissionState.RUNNING)
    ctx.exit(0 if state in (SubmissionState.DONE, *unfinished) else 1)


@click.command("cancel")
@click.argument("submission", metavar="ID|URL")
@server_options
@click.option("--yes", is_flag=True, help="Do not ask.")
def cancel(submission: str, server: str | None, token: str | None, yes: bool) -> None:
    """Cancel a submission that is queued or running.

    If none of its scenarios was started, it counts against the quota of the day only.
    """
    with open_client(server, token) as client:
        id_ = parse_id(submission)
        if not yes:
            shown = client.show(id_)
            click.confirm(f"Cancel {shown.get('name')} in {shown.get('phase')} ({shown.get('state')})?", abort=True)
        echo(f"{id_}: {format_state(client.cancel(id_))}")


def open_client(server: str | None, token: str | None) -> ChallengeClient:
    """Return a client. Raises InputError if address or token is missing."""
    for name, value in (("server", server), ("token", token)):
        if not value:
            raise InputError(f"expected --{name} or MDRIVE_{name.upper()}, found neither")
    return ChallengeClient(server or "", token or "")


def parse_id(text: str) -> str:
    """Return the id in an id or a page's address. Raises InputError."""
    if (match := _ID.fullmatch(text)) is None:
        raise InputError(
            f"submission: expected an id of 32 hexadecimal digits or the address of its page, found {text!r:.80}; "
            "`mdrive-sumo results` lists yours"
        )
    return match[1]


def _print_result(client: ChallengeClient, submission: str) -> SubmissionState:
    shown = client.show(submission)
    echo(f"{shown.get('name')} in {shown.get('phase')}, track {shown.get('track')}: {format_state(shown)}")
    if queue := shown.get("queue"):
        echo(f"position {queue.get('position')} in the queue")
    state = print_summary(shown, echo)
    rows = client.scenarios(submission)
    if rows is None:
        echo("The scenarios of this phase are hidden.")
    elif finished := [row for row in rows if row.get("verdict")]:
        echo(_format_scenarios(finished))
        echo(f"{len(finished)} of {len(rows)} scenarios have a result.")
    echo(f"page: {client.page(submission)}")
    return state


def _format_scenarios(rows: Sequence[Mapping[str, Any]]) -> str:
    ordered = sorted(rows, key=lambda row: (-1.0 if row.get("ds") is None else row["ds"], str(row.get("scenario"))))
    names = ("ds", "sr", "rc")
    lines = [
        (
            " ".join((str(row.get("scenario")), *([f"seed {row['seed']}"] if row.get("seed") else []))),
            " ".join((str(row.get("verdict")), *([f"({row['reason']})"] if row.get("reason") else []))),
            *("-" if row.get(name) is None else f"{row[name]:.2f}" for name in names),
        )
        for row in ordered
    ]
    return format_text(make_text_table(("scenario", "verdict", *(SCORES[name] for name in names)), lines))


def _format_list(rows: Sequence[Mapping[str, Any]]) -> str:
    if not rows:
        return "No submissions yet. Next: mdrive-sumo submit DIR"
    lines = [
        (
            *(str(row.get(name)) for name in ("id", "phase", "track", "name", "state")),
            f"{row['summary']['overall']['ds']:.2f}" if row.get("summary") else "-",
        )
        for row in rows
    ]
    return format_text(make_text_table(("id", "phase", "track", "name", "state", "DS"), lines))


def _write_new(file: Path, text: str) -> None:
    try:
        with file.open("x", encoding="utf-8", newline="") as target:
            target.write(text)
    except FileExistsError:
        raise InputError(f"{file}: expected a new file, found one that exists") from None
    except OSError as error:
        raise InputError(f"{file}: cannot be written: {error.strerror}") from None
