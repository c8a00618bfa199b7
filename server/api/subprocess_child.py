"""Runs in the children of `subprocess_runner`; a module of its own, for they need neither FastAPI nor SQLAlchemy."""

import os
from contextlib import suppress
from multiprocessing.connection import Connection

from mdrive_sumo.core.errors import InputError
from server.errors import StoreUnavailable


def answer_calls(pipe: Connection, nice: int) -> None:
    """Answer calls until the parent closes the pipe."""
    os.nice(nice)
    with suppress(EOFError, KeyboardInterrupt, BrokenPipeError):
        pipe.send("ready")
        while True:
            function, args, kwargs = pipe.recv()
            try:
                answer = True, function(*args, **kwargs)
            except (InputError, OSError, StoreUnavailable) as error:
                answer = False, error
            pipe.send(answer)
