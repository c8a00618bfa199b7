"""The evaluator's side of `stat_supervisor`: one process for all boxes of an evaluator, started with the first."""

import os
import socket
import sys
from pathlib import Path

from mdrive_sumo.agent_process.sandbox.launch import BoxError

PROGRAM = Path(__file__).with_name("stat_supervisor.py")
_CONTROLS: dict[int, socket.socket] = {}
"""Our end, by process: a process that was forked starts one of its own."""


def request_supervisor(uid: int | None, fstat_number: int, groups: tuple[int, ...]) -> socket.socket:
    """Return where the launch sends the listener of its filter, and which says when the supervisor has ended.

    uid: of the box; None: this user. groups: open `cgroup.procs` files of the box, which the supervisor joins, so that
    its work counts as the box's.
    """
    ours, theirs = socket.socketpair()
    with theirs:
        message = f"{-1 if uid is None else uid} {fstat_number}".encode()
        try:
            socket.send_fds(_find_control(), [message], [theirs.fileno(), *groups])
        except BrokenPipeError:  # it was killed
            _CONTROLS.pop(os.getpid()).close()
            socket.send_fds(_find_control(), [message], [theirs.fileno(), *groups])
    return ours


def has_been_killed(link: socket.socket) -> bool:
    """Return whether the supervisor of a box has ended before the box."""
    try:
        return link.recv(1, socket.MSG_DONTWAIT) == b""
    except BlockingIOError:
        return False
    except ConnectionResetError:  # before it read the listener
        return True


def _find_control() -> socket.socket:
    """Return the connection to this process's supervisor; start it if there is none."""
    if os.getpid() not in _CONTROLS:
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with theirs:
            command = (sys.executable, "-I", "-S", str(PROGRAM))
            moves = ((os.POSIX_SPAWN_DUP2, theirs.fileno(), 0),)
            # A session of its own: an interrupt at the terminal is for the evaluator, which ends its boxes first.
            try:
                os.posix_spawn(sys.executable, command, {}, file_actions=moves, setsid=True)
            except OSError as error:
                ours.close()
                raise BoxError(f"sandbox: the supervisor of boxes cannot be started: {error}") from error
        _CONTROLS[os.getpid()] = ours
    return _CONTROLS[os.getpid()]
