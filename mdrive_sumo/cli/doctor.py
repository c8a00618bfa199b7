"""`mdrive-sumo doctor`."""

import click

from mdrive_sumo.doctor import doctor_table, examine


@click.command("doctor")
def command() -> None:
    """What is installed, in which version, and what is missing for which command.

    Exits 1 if something is missing that the core commands need.
    """
    checks = examine()
    click.echo(doctor_table(checks))
    if any(check.required and not check.ok for check in checks):
        raise click.exceptions.Exit(1)
