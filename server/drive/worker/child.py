"""Child and ChildProcesses: the processes of a drive as its supervisor sees them, and their checkpoints."""

import os
import select
import signal
import socket
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from enum import StrEnum, auto

from server.drive.message_socket import MessageSocket
from server.drive.simulation_values import DriveFrame
from server.drive.worker.checkpoint_ladder import CheckpointLadder, Line
from server.drive.worker.drive_context import DriveContext
from server.drive.worker.orders import TakeOrder
from server.drive.worker.take_process import run_take_process


class ChildRole(StrEnum):
    """What a process does now."""

    STARTING = auto()
    """It repeats a take up to the tick of its order."""
    LIVE = auto()
    """People drive it."""
    LEFT = auto()
    """It waits for its turn to be finished."""
    ASIDE = auto()
    """It ends, and gives its turn to a process that begins with the journal of its take."""
    FINISHING = auto()
    HELPING = auto()
    """It computes an answer: a what-if branch, a checkpoint, a motion."""


@dataclass(eq=False, slots=True)
class Child:
    """A process and its connection."""

    connection: MessageSocket
    role: ChildRole
    order: TakeOrder | None = None
    calls: dict[int, str] = field(default_factory=dict[int, str])
    """Names of the server's calls that it has to answer, by number."""

    process: int = 0
    """Its number; 0: it has not said it yet."""
    checkpoint: tuple[int, int] | None = None
    """The checkpoint from which it was forked: its take and tick."""
    motion_of: int = 0
    """The take whose motion it builds; 0: none."""
    frame: DriveFrame | None = None
    """Its last one."""
    silent_s: float = 0.0
    """For how long it has owed a message [s]."""

    @property
    def take(self) -> int:
        """The take that it simulates; 0: none."""
        return self.order.header.take if self.order is not None else 0

    @property
    def tick(self) -> int:
        """The tick of its last frame."""
        return self.frame.tick if self.frame is not None else 0

    def tell_if_ready(self, message: object) -> None:
        """Send a message that may be lost; it does not wait for a process that does not read."""
        if select.select([], [self.connection], [], 0.0)[1]:
            self.tell(message)

    def end(self) -> None:
        """End the process at once."""
        if self.process:
            with suppress(ProcessLookupError):
                os.kill(self.process, signal.SIGKILL)

    def tell(self, message: object) -> None:
        """Send a message; one to a process that has just ended is lost, and the end of its connection tells so."""
        with suppress(OSError):
            self.connection.send(message)


class ChildProcesses:
    """The running processes of a drive, and the ladder of its checkpoints."""

    def __init__(self, server: MessageSocket) -> None:
        """server: a connection that processes must not keep."""
        self._server = server
        self.ladder = CheckpointLadder()
        self._children: list[Child] = []

    def __iter__(self) -> Iterator[Child]:
        return iter(list(self._children))

    def start(self, context: DriveContext, order: TakeOrder, line: Line, role: ChildRole) -> Child:
        """Start a process for an order: from the nearest checkpoint of a line of takes, else from tick 0."""
        line = list(line)
        while (key := self.ladder.find(line, order.header.tick)) is not None:
            ours, theirs = socket.socketpair()
            with theirs:
                if self.ladder.send(key, order, theirs.fileno()):
                    return self._add(Child(MessageSocket(ours), role, order, checkpoint=key))
            ours.close()

        def run(connection: MessageSocket) -> None:
            run_take_process(context, order, connection)

        return self._add(Child(self._fork(run), role, order))

    def start_helper(self, run: Callable[[MessageSocket], None], take: int) -> Child:
        """Start a process that builds the motion of a finished take."""
        return self._add(Child(self._fork(run), ChildRole.HELPING, motion_of=take))

    def remove(self, child: Child) -> None:
        """Forget a process that has ended."""
        self._children.remove(child)
        child.connection.close()

    def end(self, child: Child) -> None:
        """End a process that no longer answers, or the checkpoint that should have forked it."""
        child.end()
        if not child.process and child.checkpoint is not None:
            self.ladder.drop(child.checkpoint)

    def count(self, *roles: ChildRole) -> int:
        """Return how many processes have one of these roles."""
        return sum(child.role in roles for child in self._children)

    def _add(self, child: Child) -> Child:
        self._children.append(child)
        return child

    def _fork(self, run: Callable[[MessageSocket], None]) -> MessageSocket:
        """Fork a process that calls `run` with its connection and ends; return our end of it."""
        ours, theirs = socket.socketpair()
        if os.fork() == 0:
            try:
                ours.close()
                self._close_all()
                run(MessageSocket(theirs))
            finally:
                os._exit(0)
        theirs.close()
        return MessageSocket(ours)

    def _close_all(self) -> None:
        """Close, in a fork, the connections of the supervisor: else their other ends would not notice its end."""
        self._server.close()
        self.ladder.clear()
        for child in self._children:
            child.connection.close()
