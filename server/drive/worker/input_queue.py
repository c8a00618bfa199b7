"""InputQueue: the numbered inputs of one person that no tick has used yet."""

from collections import deque

from mdrive_sumo.contract import Control

MAX_WAITING = 3
"""Inputs that may wait: one a tick is sent, so more are 150 ms of delay, which came from a stall of the network."""
KEPT = 2
"""Of more, the newest that are kept."""
ROLLING = Control(throttle=0.0, brake=0.0, steer=0.0)


class InputQueue:
    """One input is used per tick, in the order of their numbers."""

    def __init__(self) -> None:
        self._waiting: deque[tuple[int, Control]] = deque()
        self._newest = 0
        self.number = 0
        """Number of the input that was used last; 0: none yet."""
        self.control = ROLLING
        """That input: pedals and wheel."""

    def put(self, number: int, control: Control) -> None:
        """Add an input. Number 1 begins a new sequence; any other that is not newer than all before is dropped."""
        if number == 1:
            self._waiting.clear()
        elif number <= self._newest:
            return
        self._newest = number
        self._waiting.append((number, control))
        if len(self._waiting) > MAX_WAITING:
            self.keep(KEPT)

    def keep(self, count: int) -> None:
        """Drop all waiting inputs but the newest ones."""
        while len(self._waiting) > count:
            self._waiting.popleft()

    def take(self) -> tuple[int, Control]:
        """Return the number and the control for this tick: the oldest that waits, else the last one again."""
        if self._waiting:
            self.number, self.control = self._waiting.popleft()
        return self.number, self.control

    def release(self) -> None:
        """Forget what is pressed, because the person drives no longer; what waits is dropped."""
        self._waiting.clear()
        self.control = ROLLING
