"""Whether a sender moves as it says: from message to message, and as it announced.

Nothing of the own sensor is needed: a sender that lies about its plans contradicts its own later positions, and one
that lies about its position contradicts it when the lie begins.
"""

from collections import deque
from dataclasses import dataclass
from itertools import pairwise

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
    """Announced positions are compared with those after this time."""
    pushed_m: float = 10.0
    """[m] How far back along its path a car may be pushed: at the 8 m/s of the benchmark for a second and more. It
    plans from the furthest place that it had reached. In honest drives it was 8 m."""
    broken_ticks: int = TICKS_PER_SECOND + TICKS_PER_SECOND // 2
    """Announcements broken in a row for so long, from the first to the last, are a lie: one event breaks what was
    announced in the horizon before it, and a collision lasts a while. In honest drives (docs/defence.md) it takes a
    second at the most, by CAVs that were struck and then wedged."""
    longest_gap_ticks: int = 2 * TICKS_PER_SECOND
    """Longer ago, a broken announcement or a line says nothing of the next: of one a second, one may be lost."""
    window_ticks: int = 2
    """The positions compared may be so much earlier or later: announcements come every 4 ticks."""
    broken_m: float = 2.5
    """[m] An announcement that is off by more is broken: a change of mind explains so much, as braking with 6 m/s2
    instead of driving on is off by 3 m after a second."""


MOTION = AnnouncedMotionParameters()


class AnnouncedMotion:
    """What one sender has said of its own motion."""

    def __init__(self, parameters: AnnouncedMotionParameters = MOTION) -> None:
        self._parameters = parameters
        self._last: tuple[int, float, float, float] | None = None
        """Tick, x, y and speed of the last position."""
        self._announced: deque[Mcm] = deque()
        self._latest: Mcm | None = None
        """The newest MCM with a plan that begins where it should."""
        self._broken_ticks: tuple[int, int] | None = None
        """When the first and the last of the broken announcements in a row were found."""

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
        """Add an MCM; return whether broken announcements in a row are too many for one event.

        Whatever happens to an honest sender at once, a change of mind or a push by another vehicle, breaks only what
        it announced within the horizon before, without the last part, in which it moves `broken_m`.
        """
        parameters, tick = self._parameters, mcm.pose.tick
        latest = tick - parameters.horizon_ticks + parameters.window_ticks
        while self._announced and self._announced[0].pose.tick < latest - 2 * parameters.window_ticks:
            self._announced.popleft()
        due = next((one for one in self._announced if one.pose.tick <= latest), None)
        begins_elsewhere = self._begins_elsewhere(mcm)
        is_broken = begins_elsewhere or (due is not None and _measure_error(due, mcm) > parameters.broken_m)
        if len(mcm.planned) and not begins_elsewhere:
            self._latest = mcm
            if portable.hypot(*_find_offset(mcm)) <= parameters.broken_m:
                self._announced.append(mcm)
        if not is_broken:
            if due is not None or not self._announced:
                self._broken_ticks = None
            return False
        first, last = self._broken_ticks or (tick, tick)
        first = tick if tick - last > parameters.longest_gap_ticks else first
        is_lie = tick - first >= parameters.broken_ticks
        self._broken_ticks = None if is_lie else (first, tick)
        return is_lie

    def _begins_elsewhere(self, mcm: Mcm) -> bool:
        """Return whether a plan begins neither at its sender nor on the line that it announced before, near it.

        A car that was struck plans from the nearest place of its path, which may be far from it for as long as it
        drives beside its path; its plans are no promises then.
        """
        x, y = _find_offset(mcm)
        most_m, before = self._parameters.broken_m, self._latest
        if not len(mcm.planned) or portable.hypot(x, y) <= most_m:
            return False
        if before is None or mcm.pose.tick - before.pose.tick > self._parameters.longest_gap_ticks:
            return False
        begin = mcm.pose.x - x, mcm.pose.y - y
        moved_m = abs(mcm.speed) * mcm.interval_s  # by a push that its last plan, a step ago, did not know of
        ahead_x, ahead_y = mcm.planned[min(AHEAD_POINTS, len(mcm.planned)) - 1] - begin
        ahead_m = portable.hypot(float(ahead_x), float(ahead_y))
        along_m = abs(x * ahead_x + y * ahead_y) / ahead_m if ahead_m >= STANDING_M else 0.0
        return along_m > self._parameters.pushed_m or _measure_gap(before, begin, mcm.pose.tick) > most_m + moved_m


AHEAD_POINTS = 6
"""The direction of a plan is that to its sixth point, 1.2 s ahead, ..."""
STANDING_M = 0.3
"""[m] ... unless that is nearer: errors of estimated positions are 0.2 m."""


def _find_offset(mcm: Mcm) -> tuple[float, float]:
    """Return where a sender is [m], seen from where its plan begins, by the first two points of the plan."""
    if len(mcm.planned) < 2:
        return 0.0, 0.0
    (x, y), (next_x, next_y) = mcm.planned[:2].tolist()
    return mcm.pose.x - (2 * x - next_x), mcm.pose.y - (2 * y - next_y)


def _measure_error(announced: Mcm, mcm: Mcm) -> float:
    """Return how far [m] a sender is from where it announced that it would be.

    Anything between the announced place and one that is as far beside it as the sender was at first keeps the promise.
    """
    x, y = _find_announced_position(announced, mcm.pose.tick)
    offset_x, offset_y = _find_offset(announced)
    return _measure_distance((mcm.pose.x, mcm.pose.y), (x, y), (x + offset_x, y + offset_y))


def _measure_gap(before: Mcm, place: tuple[float, float], tick: int) -> float:
    """Return how far [m] a place is from the part of an announced line that its sender was to drive until a tick."""
    x, y = _find_offset(before)
    line = np.vstack(((before.pose.x - x, before.pose.y - y), before.planned))
    points = line[: 2 + int((tick - before.pose.tick) * DT / before.interval_s)].tolist()
    return min(_measure_distance(place, (a, b), (c, d)) for (a, b), (c, d) in pairwise(points))


def _measure_distance(place: tuple[float, float], begin: tuple[float, float], end: tuple[float, float]) -> float:
    """Return the distance [m] of a place from a straight line between two points."""
    x, y, along_x, along_y = place[0] - begin[0], place[1] - begin[1], end[0] - begin[0], end[1] - begin[1]
    square = along_x * along_x + along_y * along_y
    share = min(max((x * along_x + y * along_y) / square, 0.0), 1.0) if square else 0.0
    return portable.hypot(x - share * along_x, y - share * along_y)


def _find_announced_position(mcm: Mcm, tick: int) -> tuple[float, float]:
    """Return the position [m] that an MCM with a plan announces for a tick; the last one if it ends before."""
    line = np.vstack(((mcm.pose.x, mcm.pose.y), mcm.planned))
    times, now = mcm.interval_s * np.arange(len(line)), (tick - mcm.pose.tick) * DT
    return float(np.interp(now, times, line[:, 0])), float(np.interp(now, times, line[:, 1]))
