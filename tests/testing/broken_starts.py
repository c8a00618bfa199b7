"""Processes of environments that never get ready. No tests in here."""

import time
from multiprocessing.connection import Connection


def end_at_once(_: Connection) -> None:
    """Die before anything is said."""


def never_answer(connection: Connection) -> None:
    """Hang until the owner gives up."""
    while not connection.closed:
        time.sleep(60.0)
