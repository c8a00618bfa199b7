"""`python -m server.drive.worker`: the processes of one drive. Standard input is the socket of the server."""

import ctypes
import os
import signal
import socket
import sys
from contextlib import suppress

from server.drive.message_socket import MessageSocket
from server.drive.worker.supervisor import DriveSupervisor

_PR_SET_CHILD_SUBREAPER = 36  # linux/prctl.h


def main() -> int:
    """Serve one drive until the server closes the connection; then all processes of the drive end."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # the kernel removes ended processes
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)  # also checkpoints whose parent has ended
    server = MessageSocket(socket.socket(fileno=os.dup(0)))
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.close(nothing)
    try:
        DriveSupervisor(server).run()
    finally:
        end_group()
    return 0


def end_group() -> None:
    """End all other processes of the drive, and wait until they are gone."""
    if os.getpgid(0) != os.getpid():
        return  # not in a session of its own, as the server starts it: the ends of their connections end them
    signal.signal(signal.SIGTERM, signal.SIG_IGN)
    os.killpg(0, signal.SIGTERM)
    with suppress(ChildProcessError):
        while True:
            os.waitpid(-1, 0)  # returns nothing while SIGCHLD is ignored, and raises once there is no child


if __name__ == "__main__":
    sys.exit(main())
