"""The one way to print and log for people: what a terminal would act on is shown, not acted on."""

import logging

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


class CleanFormatter(logging.Formatter):
    """Formats a record as one line, in which line breaks of its message are escapes; a traceback follows as lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """Return the line."""
        return clean_line(super().formatMessage(record))

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, and the lines of a traceback."""
        return clean_for_terminal(super().format(record))
