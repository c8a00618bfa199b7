"""What the store says when it says no, and the checks of text before it reaches a database."""

import secrets

from mdrive_sumo.core.errors import InputError


class NotFound(InputError):
    """Nothing has that name or id."""


class NotNow(InputError):
    """The state of things forbids it: a phase is closed, a submission is finished."""


class OverLimit(InputError):
    """A quota is used up."""

    def __init__(self, kind: str, sentence: str, retry_us: int | None) -> None:
        """`kind` is day, parallel or total; `retry_us` when to come back, None for never in this phase."""
        super().__init__(sentence)
        self.kind = kind
        self.retry_us = retry_us


def new_id() -> str:
    """128 random bits in hexadecimal."""
    return secrets.token_hex(16)


def check_text(text: str, what: str, longest: int) -> str:
    """`text` without surrounding space; raises InputError unless it has 1 .. `longest` printable characters.

    SQLite would take anything; PostgreSQL refuses NUL and over-long text with an error that helps nobody.
    """
    text = text.strip()
    if not 1 <= len(text) <= longest or not text.isprintable():
        raise InputError(f"{what}: expected 1 to {longest} printable characters, found {text[: longest + 1]!r}")
    return text
