"""Log lines for people: what others have written in them is shown and not acted on."""

import logging

from mdrive_sumo.core.clean_text import clean_for_terminal, clean_line


class CleanFormatter(logging.Formatter):
    """Formats a record as one line, in which line breaks of its message are escapes; a traceback follows as lines."""

    def formatMessage(self, record: logging.LogRecord) -> str:
        """Return the line."""
        return clean_line(super().formatMessage(record))

    def format(self, record: logging.LogRecord) -> str:
        """Return the line, and the lines of a traceback."""
        return clean_for_terminal(super().format(record))
