"""`mdrive-sumo check`: check an agent as the server would, without submitting it."""

from pathlib import Path

import click

from mdrive_sumo.agent_process.reply_decoding import AgentDeclaration
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.loop.agent_driver import AgentFailure
from server.archive import Manifest
from server.environments import Environment, current_environment, load_environment
from server.participant.packaging import unpack_agent
from server.submitted_agent import TRACK_BY_LABEL, SubmittedAgent, read_declaration

sandbox_option = click.option("--sandbox", is_flag=True, help="Start the agent in a sandbox, as the server does.")
environments_option = click.option(
    "--environments",
    type=click.Path(path_type=Path, file_okay=False),
    metavar="DIR",
    help="Folder of built environments [default: use this Python's packages instead].",
)


@click.command("check")
@click.argument("path", metavar="DIR|team.zip", type=click.Path(path_type=Path))
@sandbox_option
@environments_option
def check(path: Path, sandbox: bool, environments: Path | None) -> None:
    """Check an agent: the archive, its environment, and its sensors.

    The agent is started once in its own process; without --sandbox that process has your permissions.

    Exit codes: 0 it would be accepted, 2 it would be rejected; the message says why.
    """
    with unpack_agent(path) as unpacked:
        echo(format_manifest(unpacked.manifest))
        place = choose_environment(unpacked.manifest, environments) if sandbox or environments else None
        echo(format_declaration(ask_agent(SubmittedAgent(unpacked.manifest, unpacked.folder, place))))


def choose_environment(manifest: Manifest, environments: Path | None) -> Environment:
    """Return the requested environment, or this Python instead, with a note on stderr. Raises InputError."""
    if environments is not None:
        return load_environment(manifest.environment, environments)
    environment = current_environment()
    echo(
        f"note: {environment.name} ({environment.python}) replaces {manifest.environment}; see --environments",
        err=True,
    )
    return environment


def ask_agent(agent: SubmittedAgent) -> AgentDeclaration:
    """Return the agent's declaration. Raises InputError if it would be rejected or cannot be created."""
    try:
        return read_declaration(agent)
    except AgentFailure as error:
        raise InputError(f"agent: cannot be created: {error.text.removeprefix('InputError: ')}") from None


def format_manifest(manifest: Manifest) -> str:
    """Format the contents of an archive."""
    style = "one agent for all CAVs" if manifest.style == "joint" else "one agent for each CAV"
    lines = [
        f"archive      {manifest.files} files, {manifest.bytes} bytes, sha256 {manifest.sha256:.12}",
        f"style        {manifest.style}: {style}",
        f"environment  {manifest.environment}",
    ]
    if manifest.config is not None:
        lines.append(f"config       {manifest.config}")
    if manifest.dockerfile:
        lines.append("Dockerfile   ignored; the server does not build it")
    return "\n".join(lines)


def format_declaration(told: AgentDeclaration) -> str:
    """Format an agent's declaration."""
    sensors = ", ".join(f"{sensor.kind}:{sensor.id}" if sensor.id else sensor.kind for sensor in told.sensors)
    return f"label        {told.label}: track {TRACK_BY_LABEL[told.label]}\nsensors      {sensors or 'none'}\naccepted"
