"""Errors of the store, ids, and checks of text before it is stored: what needs no SQLAlchemy, for child processes."""

import secrets

from mdrive_sumo.core.errors import InputError


class StoreUnavailable(Exception):
    """The database does not answer, is locked for too long, or is full. Nothing was written."""


class NotFound(InputError):
    """Nothing has that name or id."""


class NotNow(InputError):
    """Not possible in the present state: a phase is closed, a submission is finished."""


class OverLimit(InputError):
    """A quota is used up."""

    def __init__(self, kind: str, sentence: str, retry_us: int | None) -> None:
        """`kind` is day, parallel, total or refused; `retry_us` the time to try again, None for never in this phase."""
        super().__init__(sentence)
        self.kind = kind
        self.retry_us = retry_us


def new_id() -> str:
    """Return 128 random bits in hexadecimal."""
    return secrets.token_hex(16)


def check_text(text: str, label: str, max_length: int) -> str:
    """Return `text` without surrounding space; raises InputError unless it has 1 .. `max_length` printable characters.

    SQLite accepts anything; PostgreSQL refuses NUL and over-long text with an unhelpful error.
    """
    text = text.strip()
    if not 1 <= len(text) <= max_length or not text.isprintable():
        raise InputError(f"{label}: expected 1 to {max_length} printable characters, found {text[: max_length + 1]!r}")
    return text
