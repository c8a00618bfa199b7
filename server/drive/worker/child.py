"""Child: a process of a drive as its supervisor sees it."""

import os
import socket
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum, auto

from server.drive.message_socket import MessageSocket
from server.drive.worker.orders import TakeOrder


class ChildRole(StrEnum):
    """What a process does now."""

    STARTING = auto()
    """It repeats a take up to the tick of its order."""
    LIVE = auto()
    """People drive it."""
    LEFT = auto()
    """It waits for its turn to be finished."""
    FINISHING = auto()
    HELPING = auto()
    """It computes an answer: a what-if branch, a checkpoint, a motion."""


@dataclass(eq=False, slots=True)
class Child:
    """A process and its connection."""

    connection: MessageSocket
    role: ChildRole
    order: TakeOrder | None = None
    calls: set[int] = field(default_factory=set[int])
    """Numbers of the server's calls that it has to answer."""

    @property
    def take(self) -> int:
        """The take that it simulates; 0: none."""
        return self.order.header.take if self.order is not None else 0


def fork_child(run: Callable[[MessageSocket], None], close: Callable[[], None]) -> MessageSocket:
    """Fork a process that calls `run` with its connection and ends; return our end of it.

    close: closes, in the process, all connections that are not its own.
    """
    ours, theirs = socket.socketpair()
    if os.fork() == 0:
        try:
            ours.close()
            close()
            run(MessageSocket(theirs))
        finally:
            os._exit(0)
    theirs.close()
    return MessageSocket(ours)
