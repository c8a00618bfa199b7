"""A process of its own for what takes long, or reads what strangers sent: it can be ended, a thread cannot.

It is started when first needed, stays for the next call (starting takes longer than most calls), and is ended with a
call that takes too long or breaks it.
"""

import os
from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from threading import BoundedSemaphore, Lock
from typing import Any, ParamSpec, Protocol, TypeVar

from mdrive_sumo.core.errors import InputError
from server.api.problems import ProblemError
from server.store import StoreUnavailable

P = ParamSpec("P")
R = TypeVar("R")
_END_S = 5.0


class CallRunner(Protocol):
    """Where to do it."""

    def call(self, seconds: float, deed: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> R:
        """What `deed` returns. Raises its InputErrors, OSErrors and StoreUnavailable; ProblemError if it takes too long
        or breaks."""
        ...

    def close(self) -> None:
        """No more calls."""
        ...


class SubprocessRunner:
    """In one child process, one call at a time. Safe to use from several threads."""

    def __init__(self, most: int, nice: int = 0) -> None:
        """most: calls at a time; nice: how much others of this machine go before it, see `nice(2)`."""
        self._nice, self._closed = nice, False
        self._places = BoundedSemaphore(most)
        self._turn = Lock()
        self._child: tuple[BaseProcess, Connection] | None = None

    def call(self, seconds: float, deed: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> R:
        """See `Aside`. Arguments and result are pickled; waiting for one's turn has the same limit again.

        Of too many calls at a time the others are not done: ProblemError at once.
        """
        if not self._places.acquire(blocking=False):
            raise _busy_error("too many at a time")
        try:
            good, value = self._in_turn((deed, args, kwargs), seconds)
        finally:
            self._places.release()
        if not good:
            raise value
        return value

    def close(self) -> None:
        """Ends the child, whatever it is doing; whoever waits is refused."""
        self._closed = True
        if (child := self._child) is not None:
            child[0].kill()  # whoever waits for its answer gives the turn back
        with self._turn:
            self._end()

    def _in_turn(self, question: object, seconds: float) -> tuple[bool, Any]:
        if not self._turn.acquire(timeout=seconds):
            raise _busy_error("too many at a time")
        try:
            if self._closed:
                raise _busy_error("the server ends")
            return self._asked(question, seconds)
        finally:
            self._turn.release()

    def _asked(self, question: object, seconds: float) -> tuple[bool, Any]:
        if self._child is None or not self._child[0].is_alive():
            self._end()
            self._child = _start_child(self._nice)
        pipe = self._child[1]
        try:
            pipe.send(question)
            if pipe.poll(seconds):
                return pipe.recv()
            problem = f"it took longer than {seconds:g} s"
        except (EOFError, OSError):
            problem = "its process ended"
        self._end()
        raise _busy_error(problem)

    def _end(self) -> None:
        if self._child is not None:
            process, pipe = self._child
            pipe.close()
            process.kill()
            process.join(_END_S)
            self._child = None


def _start_child(nice: int) -> tuple[BaseProcess, Connection]:
    ours, its = get_context("spawn").Pipe()
    process = get_context("spawn").Process(target=_run_child, args=(its, nice), daemon=True, name="mdrive-aside")
    process.start()
    its.close()
    return process, ours


def _run_child(pipe: Connection, nice: int) -> None:
    """In the child: answers until the parent is gone."""
    os.nice(nice)
    with suppress(EOFError, KeyboardInterrupt, BrokenPipeError):
        while True:
            deed, args, kwargs = pipe.recv()
            try:
                answer = True, deed(*args, **kwargs)
            except (InputError, OSError, StoreUnavailable) as error:
                answer = False, error
            pipe.send(answer)


def _busy_error(problem: str) -> ProblemError:
    sentence = f"this cannot be done now: {problem}; come back later"
    return ProblemError(HTTPStatus.SERVICE_UNAVAILABLE, "busy", sentence, {"Retry-After": "30"})
