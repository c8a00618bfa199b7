"""`mdrive-sumo check`: what the server would say of an archive, without sending it."""

from pathlib import Path

import click

from mdrive_sumo.agent_process.reply_decoding import AgentDeclaration
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.loop.agent_driver import AgentFailure
from server.archive import Manifest
from server.environments import Environment, current_environment, load_environment
from server.participant.packaging import unpack_agent
from server.submitted_agent import TRACK_BY_LABEL, SubmittedAgent, read_declaration

sandbox_option = click.option("--sandbox", is_flag=True, help="Ask the agent in a box, as the server does.")
environments_option = click.option(
    "--environments",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Where environments are built [default: this Python's packages stand in for them].",
)


@click.command("check")
@click.argument("path", metavar="DIR|team.zip", type=click.Path(path_type=Path))
@sandbox_option
@environments_option
def check(path: Path, sandbox: bool, environments: Path | None) -> None:
    """Check an agent: the archive, its environment, and what it asks for.

    The agent is made once, in a process of its own; without --sandbox that process may do what you may.

    Exit codes: 0 it would be accepted, 2 it would be rejected; the sentence says what to mend.
    """
    with unpack_agent(path) as found:
        click.echo(format_manifest(found.manifest))
        place = choose_environment(found.manifest, environments) if sandbox or environments else None
        click.echo(format_declaration(ask_agent(SubmittedAgent(found.manifest, found.folder, place))))


def choose_environment(manifest: Manifest, environments: Path | None) -> Environment:
    """The environment that is asked for, or this Python in its place, which is said. Raises InputError."""
    if environments is not None:
        return load_environment(manifest.environment, environments)
    found = current_environment()
    click.echo(f"note: {found.name} ({found.python}) stands in for {manifest.environment}; or --environments", err=True)
    return found


def ask_agent(entrant: SubmittedAgent) -> AgentDeclaration:
    """What the agent declares; raises InputError, one sentence, if it would be rejected or cannot be made."""
    try:
        return read_declaration(entrant)
    except AgentFailure as error:
        raise InputError(f"agent: cannot be made: {error.text.removeprefix('InputError: ')}") from None


def format_manifest(manifest: Manifest) -> str:
    """What an archive holds."""
    style = "one agent for all CAVs" if manifest.style == "joint" else "one agent for each CAV"
    lines = [
        f"archive      {manifest.files} files, {manifest.bytes} bytes, sha256 {manifest.sha256:.12}",
        f"style        {manifest.style}: {style}",
        f"environment  {manifest.environment}",
    ]
    if manifest.config is not None:
        lines.append(f"config       {manifest.config}")
    if manifest.dockerfile:
        lines.append("Dockerfile   noted; the server does not build it")
    return "\n".join(lines)


def format_declaration(found: AgentDeclaration) -> str:
    """What an agent declares."""
    sensors = ", ".join(f"{sensor.kind}:{sensor.id}" if sensor.id else sensor.kind for sensor in found.sensors)
    return (
        f"label        {found.label}: track {TRACK_BY_LABEL[found.label]}\nsensors      {sensors or 'none'}\naccepted"
    )
