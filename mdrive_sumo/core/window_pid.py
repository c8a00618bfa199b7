"""WindowPid: the PID element of the published controllers of CoLMDriver, TCP, UniAD, VAD and LMDrive."""

import math
from collections import deque


class WindowPid:
    """P e + I mean(window) + D (e - previous e); the window starts full of zeros (protocol 11.1)."""

    def __init__(self, gains: tuple[float, float, float], window: int) -> None:
        self._gains = gains
        self._errors = deque([0.0] * window, maxlen=window)

    def __call__(self, error: float) -> float:
        """Return the PID output for the next error."""
        p, i, d = self._gains
        previous = self._errors[-1]
        self._errors.append(error)
        return p * error + i * math.fsum(self._errors) / len(self._errors) + d * (error - previous)
