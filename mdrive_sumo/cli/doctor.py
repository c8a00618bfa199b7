"""`mdrive-sumo doctor`."""

import click

from mdrive_sumo.agent_process.sandbox import examine_backend, try_own_kernel
from mdrive_sumo.core.terminal import echo
from mdrive_sumo.report.installation import examine_installation, format_installation_table, format_sandbox_table

NEEDED_LAYERS = ("namespaces", "read-only", "privileges", "seccomp", "rlimits")
"""Without these there is no sandbox; the others depend on who starts it and on the machine."""


@click.command("doctor")
@click.option("--sandbox", is_flag=True, help="Look at the sandbox for other people's agents instead.")
def command(sandbox: bool) -> None:
    """What is installed, in which version, and what is missing for which command.

    Exits 1 if something is missing that the core commands need, with --sandbox if no sandbox can be had.
    """
    if sandbox:
        backend, found = examine_backend()
        echo(format_sandbox_table(found, backend, try_own_kernel()))
        complete = all(layer.active for layer in found if layer.name in NEEDED_LAYERS)
    else:
        checks = examine_installation()
        echo(format_installation_table(checks))
        complete = all(check.is_found for check in checks if check.is_required)
    if not complete:
        raise click.exceptions.Exit(1)
