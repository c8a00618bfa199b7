"""MotionCalls: the motions of finished takes: those that were asked for, and some ahead of that."""

import os
from collections.abc import Callable
from contextlib import suppress

from mdrive_sumo.core.errors import InputError
from server.drive.message_socket import MessageSocket
from server.drive.take_tree import TakeStatus
from server.drive.worker.child import Child, ChildProcesses
from server.drive.worker.motion import MotionCache, make_motion_sender
from server.drive.worker.open_drive import OpenDrive
from server.drive.worker.orders import MotionLoaded
from server.drive.worker.take_process import BACKGROUND_NICE

AHEAD_TAKES = 4
"""The newest takes of earlier sessions whose motion is loaded before a page asks for it. A recording of a minute with
90 road users takes 1.2 s of one core: 85 % of it for brake lamps and indicators, which recordings do not hold."""


class MotionCalls:
    """Every motion is built once, by a process of its own, however many pages ask for it."""

    def __init__(self, children: ChildProcesses, answer: Callable[[int, bytes], None]) -> None:
        """answer: sends the motion for a call of the server."""
        self._children, self._answer = children, answer
        self._cache = MotionCache()
        self._tried: set[int] = set()

    def keep(self, take: int, motion: bytes) -> None:
        """Keep the motion of a take that has just been finished."""
        self._tried.add(take)
        self._cache.add(take, motion)

    def ask(self, number: int, take: int, drive: OpenDrive) -> None:
        """Answer a call, now or when its motion is built. Raises InputError without a recording."""
        if (motion := self._cache.find(take)) is not None:
            self._answer(number, motion)
            return
        loading = next((child for child in self._children if child.motion_of == take), None)
        child = loading or self._start(take, drive, niceness=0)
        child.calls[number] = "load_motion"

    def load_ahead(self, drive: OpenDrive) -> None:
        """Load the motion of one more take, if no page has asked yet. Call it while there is nothing else to do."""
        finished = [number for number, take in drive.tree.takes.items() if take.status is TakeStatus.FINISHED]
        for take in sorted(finished)[: -AHEAD_TAKES - 1 : -1]:
            if take not in self._tried:
                with suppress(InputError):  # its files are gone; who asks for it is told
                    self._start(take, drive, BACKGROUND_NICE)
                    return

    def hear(self, child: Child, message: MotionLoaded) -> None:
        """Keep a motion, and answer those who wait for it."""
        self.keep(message.take, message.motion)
        calls, child.calls = child.calls, {}
        for number in calls:
            self._answer(number, message.motion)

    def _start(self, take: int, drive: OpenDrive, niceness: int) -> Child:
        self._tried.add(take)
        send_motion = make_motion_sender(drive.context, drive.tree.find_folder(take), take)

        def run(connection: MessageSocket) -> None:
            os.nice(niceness)
            send_motion(connection)

        return self._children.start_helper(run, take)
