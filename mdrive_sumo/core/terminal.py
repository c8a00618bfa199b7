"""The one way to print for people: what a terminal would act on is shown, not acted on."""

import click

from mdrive_sumo.core.clean_text import clean_for_terminal, clean_line

CLEAR_LINE = "\r\x1b[K"
"""Back to the begin of the line, and clear it (ECMA-48, EL)."""


def echo(message: object = "", *, err: bool = False) -> None:
    """Print a message, cleaned, to standard output or standard error."""
    click.echo(clean_for_terminal(str(message)), err=err)


def echo_live(line: str) -> None:
    """Show a line on the standard error of a terminal in place of the one before; "" clears it."""
    click.echo(CLEAR_LINE + clean_line(line), nl=False, err=True)
