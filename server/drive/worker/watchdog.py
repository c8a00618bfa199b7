"""Watchdog: which processes of a drive no longer answer."""

from collections.abc import Iterable

from server.drive.protocol import FrameState
from server.drive.simulation_values import TICK_LIMIT_S
from server.drive.worker.child import Child, ChildRole

WATCH_S = 0.5
"""Longest time between two looks at the processes [s]."""
WORK_LIMIT_S = 120.0
"""Silence of a process in the background after which it hangs [s]. It speaks every second while it simulates; to start
the simulator, and to score a take, needs a few seconds on a loaded machine."""
MAX_COUNTED_S = 2 * WATCH_S
"""Of one look: if all processes stood, as those of a virtual machine may, none of them hangs."""


class Watchdog:
    """Counts for how long each process has owed a message."""

    def __init__(self, tick_limit_s: float = TICK_LIMIT_S) -> None:
        """tick_limit_s: longest time without a tick while the clock of the live take runs [s]."""
        self._tick_limit_s = tick_limit_s

    def is_needed(self, children: Iterable[Child]) -> bool:
        """Return whether a process owes a message."""
        return any(_is_owing(child) for child in children)

    def find_hanging(self, children: Iterable[Child], waited_s: float) -> list[Child]:
        """Count the time since the last look [s], and return the processes that have been silent for too long."""
        hanging: list[Child] = []
        for child in children:
            if not _is_owing(child):
                child.silent_s = 0.0
                continue
            child.silent_s += min(waited_s, MAX_COUNTED_S)
            if child.silent_s > self._find_limit_s(child):
                hanging.append(child)
        return hanging

    def _find_limit_s(self, child: Child) -> float:
        return self._tick_limit_s if child.role is ChildRole.LIVE else WORK_LIMIT_S

    def describe(self, child: Child) -> str:
        """Return what has happened to a process that hangs."""
        return f"has said nothing for {self._find_limit_s(child):g} s and was ended"


def _is_owing(child: Child) -> bool:
    """Return whether a process that works would say something soon."""
    if child.order is None:
        return False  # it computes one answer, and says nothing before
    if child.role in (ChildRole.STARTING, ChildRole.FINISHING) or child.calls:
        return True
    is_running = child.frame is not None and child.frame.state in (FrameState.RUNNING, FrameState.SLOW)
    return child.role is ChildRole.LIVE and is_running
