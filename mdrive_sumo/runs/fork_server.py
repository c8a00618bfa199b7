"""ForkServer: a process that has imported what jobs need, and forks worker processes.

The imports take two thirds of a second of processor time, a fork some milliseconds. The server is a fresh interpreter
("spawn") with one thread, in which no simulation has run: threads of its owner do not matter, and libsumo, which holds
one simulation a process, is loaded but unused in every new worker. Each worker has a process group of its own: Ctrl-C
reaches only the owner of the server, and a worker ends with the agents that it started.
"""

import ctypes
import gc
import os
import pickle
import signal
import socket
import sys
from collections.abc import Callable, Generator
from contextlib import contextmanager, suppress
from importlib import import_module
from multiprocessing import current_process, get_context, parent_process
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from threading import Lock
from types import ModuleType
from typing import NamedTuple

from mdrive_sumo.core.posix import check_posix

LATE_IMPORTS = {"mdrive_sumo.loop": "mdrive_sumo.sumo"}
"""What jobs import only when they drive, by the module that they have then imported; it takes a fifth of a second."""
Serve = Callable[[Connection], None]
"""What a worker does: serve its owner at the other end of a connection until that is closed."""
_REQUEST = b"."
_READY = b"+"
"""First byte that a server sends: it can fork workers. Else it sends the sentence why it cannot."""
_MAX_SENTENCE_BYTES = 1000
_PR_SET_PDEATHSIG = 1  # linux/prctl.h


class ForkServer:
    """Starts worker processes that call `serve`, which is top-level and picklable; they end with it.

    It ends with the *thread* that created it: use it in one thread only.
    """

    def __init__(self, serve: Serve) -> None:
        check_posix("a worker process")
        self._serve = serve
        self._failure = ""
        """Why the server before this one could not fork workers; "": it could, or was killed."""
        self._requests, self._process = self._start()

    def start_worker(self, theirs: Connection, state: Connection) -> None:
        """Fork a worker that serves this connection; over `state` come its process id and, at its end, its exit code.

        The caller then closes its copies of both. If the server dies first, both are closed at once. A server that has
        died, and its workers with it, is replaced.
        """
        if not self._process.is_alive():
            self._failure = self.find_start_failure()
            self.end()
            self._requests, self._process = self._start()
        with suppress(BrokenPipeError, ConnectionResetError):  # it has just died
            socket.send_fds(self._requests, [_REQUEST], [theirs.fileno(), state.fileno()])

    @property
    def exit_code(self) -> int | None:
        """Exit code of a server that has died, and its workers with it; None while it runs."""
        self._process.join(timeout=1.0)  # its connections are closed before it is gone
        return self._process.exitcode

    def find_start_failure(self) -> str:
        """Return why a dead server could fork no workers, e.g. a missing module; "" if it could, or was killed."""
        if self._failure or not self.exit_code or self.exit_code < 0:
            return self._failure
        try:
            told = self._requests.recv(_MAX_SENTENCE_BYTES, socket.MSG_DONTWAIT | socket.MSG_PEEK)
        except OSError:  # it ended before it could say anything
            told = b""
        if told.startswith(_READY):
            return ""
        return told.decode("utf-8", "replace") or f"the first of them ended with exit code {self.exit_code}"

    def end(self) -> None:
        """End the server and all workers that are left."""
        self._requests.close()
        self._process.kill()
        self._process.join()

    def _start(self) -> tuple[socket.socket, BaseProcess]:
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # a core for each worker: numpy's own threads only fight
        if current_process().daemon:  # as workers of Dask are: Python would let them have no processes of their own
            current_process().daemon = False
        requests, theirs = socket.socketpair()
        # A daemon: the interpreter still ends it, and it its workers, if a second Ctrl-C comes before its owner does.
        process = get_context("spawn").Process(
            target=_serve_forks, args=(theirs, pickle.dumps(self._serve)), name="mdrive-sumo fork server", daemon=True
        )
        with theirs, block_interrupts(), _hide_main_module():  # it inherits the mask until it leaves our process group
            process.start()
        return requests, process


@contextmanager
def block_interrupts() -> Generator[None]:
    """Block SIGINT until the end of the block."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


_MAIN_MODULE_LOCK = Lock()


@contextmanager
def _hide_main_module() -> Generator[None]:
    """Keep a spawned child from importing the caller's `__main__`.

    A worker needs nothing of it, and the import would run a script that has no main guard a second time.
    """
    with _MAIN_MODULE_LOCK:
        main = sys.modules["__main__"]
        sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


class _Worker(NamedTuple):
    process: BaseProcess
    state: Connection


def _serve_forks(requests: socket.socket, pickled: bytes) -> None:
    """Fork workers and report their ends until the owner closes the socket or dies.

    pickled: the `Serve`, whose reading imports what jobs need.
    """
    _leave_group_of_parent()
    gc.disable()  # all that is imported stays: looking for garbage in it takes a tenth of the time
    serve = _import_all(requests, pickled)
    requests.send(_READY)
    gc.enable()
    gc.freeze()  # else the first collection of each worker would write to, and so copy, all that they share
    current_process().daemon = False  # Python would let it have no processes of its own
    worker_by_sentinel: dict[int, _Worker] = {}
    while True:
        for ready in wait([requests, *worker_by_sentinel]):
            if isinstance(ready, int):
                _report_end(worker_by_sentinel.pop(ready))
                continue
            try:
                message, descriptors, _, _ = socket.recv_fds(requests, len(_REQUEST), 2)
            except ConnectionResetError:  # the owner closed its end before it read `_READY`
                return
            if not message:
                return
            worker = _fork_worker(requests, serve, *map(Connection, descriptors))
            worker_by_sentinel[worker.process.sentinel] = worker


def _import_all(requests: socket.socket, pickled: bytes) -> Serve:
    """Return the `Serve` with all that jobs import; if that cannot be imported, tell the owner why, and end."""
    try:
        serve: Serve = pickle.loads(pickled)
        for module, late in LATE_IMPORTS.items():
            if module in sys.modules:
                import_module(late)
    except Exception as error:  # noqa: BLE001 - imports run any code; the owner says it in one sentence
        sentence = " ".join(f"{type(error).__name__}: {error}".split()).encode("utf-8", "replace")
        with suppress(OSError):
            requests.send(sentence[:_MAX_SENTENCE_BYTES])
        sys.exit(1)
    return serve


def _fork_worker(requests: socket.socket, serve: Serve, theirs: Connection, state: Connection) -> _Worker:
    process = get_context("fork").Process(
        target=_run_worker, args=(requests, state, serve, theirs), name="mdrive-sumo worker", daemon=True
    )
    process.start()
    theirs.close()
    _tell_owner(state, process.pid)
    return _Worker(process, state)


def _run_worker(requests: socket.socket, state: Connection, serve: Serve, theirs: Connection) -> None:
    _leave_group_of_parent()
    requests.close()  # else the server's owner would not notice its death
    state.close()
    serve(theirs)


def _report_end(worker: _Worker) -> None:
    worker.process.join()
    _tell_owner(worker.state, worker.process.exitcode)
    worker.state.close()


def _tell_owner(state: Connection, number: int | None) -> None:
    with suppress(BrokenPipeError):  # it no longer wants to know
        state.send(number)


def _leave_group_of_parent() -> None:
    """Be out of reach of the terminal, but end with the parent.

    Linux sends SIGKILL then; elsewhere the closed connection ends a worker after its job.
    """
    os.setpgid(0, 0)
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGINT})
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    parent = parent_process()
    if parent is not None and os.getppid() != parent.pid:  # it died before the line above
        os._exit(1)
