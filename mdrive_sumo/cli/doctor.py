"""`mdrive-sumo doctor`."""

import click

from mdrive_sumo.agent_process.sandbox import examine_backend, try_own_kernel
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.agent_examination import examine_agent, find_agent, format_agent_table
from mdrive_sumo.report.installation import examine_installation, format_installation_table, format_sandbox_table

NEEDED_LAYERS = ("namespaces", "read-only", "privileges", "seccomp", "rlimits")
"""Without these there is no sandbox; the others depend on who starts it and on the machine."""


@click.command("doctor")
@click.option("--sandbox", is_flag=True, help="Look at the sandbox for other people's agents instead.")
@click.option(
    "--agent", metavar="FILE[:Class]", help="Look at an agent instead; its code runs once, to declare its sensors."
)
def command(sandbox: bool, agent: str | None) -> None:
    """What is installed, in which version, and what is missing for which command.

    With --agent: which imports, names of CARLA and sensors of an agent cannot be had here.

    Exits 1 if something is missing that the core commands need, with --sandbox if no sandbox can be had, with --agent
    if something of the agent is missing.
    """
    if agent is not None:
        if sandbox:
            raise InputError("doctor: expected one of --agent and --sandbox, found both")
        findings = examine_agent(find_agent(agent))
        echo(format_agent_table(findings))
        complete = all(finding.is_found for finding in findings)
    elif sandbox:
        backend, found = examine_backend()
        echo(format_sandbox_table(found, backend, try_own_kernel()))
        complete = all(layer.active for layer in found if layer.name in NEEDED_LAYERS)
    else:
        checks = examine_installation()
        echo(format_installation_table(checks))
        complete = all(check.is_found for check in checks if check.is_required)
    if not complete:
        raise click.exceptions.Exit(1)
