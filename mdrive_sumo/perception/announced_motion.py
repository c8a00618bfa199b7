"""Whether a sender moves as it says: from message to message, and as it announced.

Nothing of the own sensor is needed: a sender that lies about its plans contradicts its own later positions, and one
that lies about its position contradicts it when the lie begins.
"""

from collections import deque
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.state import DT, TICKS_PER_SECOND
from mdrive_sumo.v2x.messages import Cam, Denm, Mcm


@dataclass(frozen=True, slots=True)
class AnnouncedMotionParameters:
    """Parameters of `AnnouncedMotion`."""

    jump_m: float = 5.0
    """[m] A sender that is further off than its speeds allow has not driven there. Errors of estimated positions are
    0.2 m; the paper's pose error, 0.6 m a coordinate and drawn for every message, exceeds this once in 3e7 pairs."""
    longest_ticks: int = TICKS_PER_SECOND
    """Positions further apart in time are not compared."""
    horizon_ticks: int = TICKS_PER_SECOND
    """Announced positions are compared with those after this time: a planner may change its mind at once, but a car
    that then brakes with 6 m/s2 is off by 3 m at the most."""
    window_ticks: int = 2
    """The positions compared may be so much earlier or later: announcements come every 4 ticks."""
    broken_m: float = 2.5
    """[m] An announcement that is off by more is broken. Chosen by honest drives, see docs/attacks.md."""
    broken_count: int = 4
    """So many broken announcements in a row are a lie: those before a sudden stop are at most 3."""


MOTION = AnnouncedMotionParameters()


class AnnouncedMotion:
    """What one sender has said of its own motion."""

    def __init__(self, parameters: AnnouncedMotionParameters = MOTION) -> None:
        self._parameters = parameters
        self._last: tuple[int, float, float, float] | None = None
        """Tick, x, y and speed of the last position."""
        self._announced: deque[Mcm] = deque()
        self._broken_count = 0

    def add(self, content: Cam | Mcm | Denm) -> bool:
        """Add a message; return whether it contradicts what the sender said before."""
        is_jump = self._jumps(content)
        if isinstance(content, Mcm):
            return self._breaks_announcements(content) or is_jump
        return is_jump

    def _jumps(self, content: Cam | Mcm | Denm) -> bool:
        pose, last = content.pose, self._last
        self._last = pose.tick, pose.x, pose.y, abs(content.speed)
        if last is None or not 0 <= pose.tick - last[0] <= self._parameters.longest_ticks:
            return False
        reach = max(last[3], abs(content.speed)) * (pose.tick - last[0]) * DT + self._parameters.jump_m
        return bool(portable.hypot(pose.x - last[1], pose.y - last[2]) > reach)

    def _breaks_announcements(self, mcm: Mcm) -> bool:
        parameters, tick = self._parameters, mcm.pose.tick
        latest = tick - parameters.horizon_ticks + parameters.window_ticks
        while self._announced and self._announced[0].pose.tick < latest - 2 * parameters.window_ticks:
            self._announced.popleft()
        due = [one for one in self._announced if one.pose.tick <= latest]
        if len(mcm.planned):
            self._announced.append(mcm)
        if not due:
            return False
        x, y = _find_announced_position(due[0], tick)
        is_broken = portable.hypot(mcm.pose.x - x, mcm.pose.y - y) > parameters.broken_m
        self._broken_count = self._broken_count + 1 if is_broken else 0
        if self._broken_count < parameters.broken_count:
            return False
        self._broken_count = 0
        return True


def _find_announced_position(mcm: Mcm, tick: int) -> tuple[float, float]:
    """Return the position [m] that an MCM with a plan announces for a tick; the last one if it ends before."""
    line = np.vstack(((mcm.pose.x, mcm.pose.y), mcm.planned))
    times, now = mcm.interval_s * np.arange(len(line)), (tick - mcm.pose.tick) * DT
    return float(np.interp(now, times, line[:, 0])), float(np.interp(now, times, line[:, 1]))
