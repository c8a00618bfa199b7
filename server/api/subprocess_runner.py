"""Runs slow calls, and calls on untrusted input, in a subprocess, because a process can be killed and a thread cannot.

The child starts with the first call and stays for the next one, since starting takes longer than most calls. A call
that exceeds its time limit or crashes ends the child. One whose child is ended by a signal that an operator, earlyoom
or a service manager may have sent is made once more.
"""

from collections.abc import Callable
from contextlib import suppress
from http import HTTPStatus
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from queue import Empty, LifoQueue
from threading import BoundedSemaphore, Lock
from typing import Any, ParamSpec, Protocol, TypeVar

from mdrive_sumo.agent_process.sandbox.box import OUTSIDE_SIGNALS
from server.api.child_calls import answer_calls
from server.api.problems import ProblemError

P = ParamSpec("P")
R = TypeVar("R")
_KILL_S = 5.0
"""Time until a killed child is left to the kernel [s]: it may hang in a system call."""
START_S = 60.0
"""Time limit of the start of a child [s]; it is no part of the limit of the call that needs the child."""


class CallEndedError(ProblemError):
    """The call exceeded its time limit or crashed (503): what it worked on may be the reason."""


class CallRunner(Protocol):
    """Executes function calls under a time limit."""

    def call(self, limit_s: float, function: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> R:
        """Return `function(*args, **kwargs)`.

        Raises InputError, OSError and StoreUnavailable of the function; CallEndedError if it takes too long or crashes;
        ProblemError (503) if it was not begun.
        """
        ...

    def close(self) -> None:
        """End the runner."""
        ...


class SubprocessRunner:
    """Executes calls in one child process, one at a time. Thread-safe."""

    def __init__(self, max_calls: int, nice: int = 0) -> None:
        """Accept at most `max_calls` running and waiting calls; the child runs with that niceness (`nice(2)`)."""
        self._nice, self._closed = nice, False
        self._slots = BoundedSemaphore(max_calls)
        self._turn = Lock()
        self._child: tuple[BaseProcess, Connection] | None = None

    def call(self, limit_s: float, function: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> R:
        """See `CallRunner`. Arguments and result are pickled; waiting for earlier calls has the same time limit.

        Raises ProblemError (503) at once where too many calls wait.
        """
        if not self._slots.acquire(blocking=False):
            raise _busy_error("too many at a time")
        try:
            succeeded, value = self._wait_and_call((function, args, kwargs), limit_s)
        finally:
            self._slots.release()
        if not succeeded:
            raise value
        return value

    def close(self) -> None:
        """Kill the child; waiting calls raise ProblemError."""
        self._closed = True
        if (child := self._child) is not None:
            child[0].kill()  # the call that waits for its answer then releases the lock
        with self._turn:
            self._end_child()

    def _wait_and_call(self, request: object, limit_s: float) -> tuple[bool, Any]:
        if not self._turn.acquire(timeout=limit_s):
            raise _busy_error("too many at a time")
        try:
            if self._closed:
                raise _busy_error("the server is shutting down")
            return self._send(request, limit_s)
        finally:
            self._turn.release()

    def _send(self, request: object, limit_s: float, *, is_repeated: bool = False) -> tuple[bool, Any]:
        if self._child is None or not self._child[0].is_alive():
            self._end_child()
            self._child = _start_child(self._nice)
            self._wait_until_ready(self._child[1])
        process, pipe = self._child
        try:
            pipe.send(request)
            if pipe.poll(limit_s):
                return pipe.recv()
            problem = f"it took longer than {limit_s:g} s"
        except (EOFError, OSError):
            problem = "its process ended"
            process.join(_KILL_S)
        is_killed = process.exitcode is not None and -process.exitcode in OUTSIDE_SIGNALS
        self._end_child()
        if is_killed and not is_repeated and not self._closed:
            return self._send(request, limit_s, is_repeated=True)
        raise _describe_busy(CallEndedError, problem)

    def _wait_until_ready(self, pipe: Connection) -> None:
        with suppress(EOFError, OSError):
            if pipe.poll(START_S):
                pipe.recv()
                return
        self._end_child()
        raise _busy_error("its process does not start")

    def _end_child(self) -> None:
        if self._child is not None:
            process, pipe = self._child
            pipe.close()
            process.kill()
            process.join(_KILL_S)
            self._child = None


def _start_child(nice: int) -> tuple[BaseProcess, Connection]:
    parent_end, child_end = get_context("spawn").Pipe()
    process = get_context("spawn").Process(
        target=answer_calls, args=(child_end, nice), daemon=True, name="mdrive-runner"
    )
    process.start()
    child_end.close()
    return process, parent_end


def _busy_error(problem: str) -> ProblemError:
    return _describe_busy(ProblemError, problem)


def _describe_busy(kind: type[ProblemError], problem: str) -> ProblemError:
    sentence = f"this cannot be done now: {problem}; try again later"
    return kind(HTTPStatus.SERVICE_UNAVAILABLE, "busy", sentence, {"Retry-After": "30"})


class SubprocessPool:
    """Executes calls in several child processes, each one call at a time. Thread-safe."""

    def __init__(self, processes: int, nice: int = 0) -> None:
        """Prepare that many child processes; each starts with its first call."""
        self._all = [SubprocessRunner(2, nice) for _ in range(processes)]  # a second call comes in while one is closed
        self._free: LifoQueue[SubprocessRunner] = LifoQueue()
        for runner in reversed(self._all):
            self._free.put(runner)

    def call(self, limit_s: float, function: Callable[P, R], /, *args: P.args, **kwargs: P.kwargs) -> R:
        """See `CallRunner`. Raises ProblemError (503) if no child becomes free within the time limit."""
        try:
            runner = self._free.get(timeout=limit_s)
        except Empty:
            raise _busy_error("too many at a time") from None
        try:
            return runner.call(limit_s, function, *args, **kwargs)
        finally:
            self._free.put(runner)

    def start(self) -> None:
        """Start all children. Raises ProblemError."""
        for runner in self._all:
            runner.call(START_S, int)

    def close(self) -> None:
        """Kill the children; waiting calls raise ProblemError."""
        for runner in self._all:
            runner.close()
