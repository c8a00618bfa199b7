"""Where and when a CAV's route and the drive of another road user exclude each other."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.study.need.motion import RouteMotion

SPACING_M = 0.2
"""Between stations at which boxes are compared."""
LATERAL_M = 0.25
"""A CAV's centre stays within this distance of its route; a lane of 3.2 m leaves 0.6 m to either side."""
TURN_M = 0.05
"""Displacement of a box's corner by the turn of a route between two stations."""
MAX_LENGTH_M = 12.0
"""Of a zone along the route: two cars' lengths and a lane's width at a right angle are less."""
MOVED_M = 5.0
"""A road user that moves less in the whole drive has no drive to shift in time."""


@dataclass(frozen=True, slots=True)
class ConflictZone:
    """A CAV at any station in [enter_m, leave_m] overlaps the road user at any tick of its drive in [enter, leave]."""

    road_user: int
    """Column of the road user in the recording."""
    enter_m: float
    leave_m: float
    enter: int
    leave: int
    point: tuple[float, float]
    """The CAV's centre at the begin of the zone [m]."""


@dataclass(frozen=True)
class ZoneFinder:
    """Zones of one CAV with the road users of a recording."""

    record: EpisodeRecord
    ego: int
    motion: RouteMotion

    def find_zones(self) -> Iterator[ConflictZone]:
        """Yield the first zone with every moving road user whose drive crosses the route."""
        for column in self._list_near():
            zone = self._find_zone(column)
            if zone is not None:
                yield zone

    def _list_near(self) -> list[int]:
        """Return the road users that move and come near the route."""
        record, ticks = self.record, np.arange(0, self.record.ticks, 4)
        columns = [i for i in range(len(record.ids)) if i != self.ego and self._has_moved(i)]
        route = np.array([self.motion.line.at(s) for s in np.arange(0.0, self.motion.line.length, 2.0).tolist()])
        low, high = route.min(0) - 10.0, route.max(0) + 10.0
        near: list[int] = []
        for i in columns:
            present = ticks[record.valid[ticks, i]]
            x, y = record.x[present, i], record.y[present, i]
            inside = (x > low[0]) & (x < high[0]) & (y > low[1]) & (y < high[1])
            x, y = x[inside], y[inside]
            gaps = portable.hypot(x[:, None] - route[None, :, 0], y[:, None] - route[None, :, 1])
            if gaps.size and gaps.min() < self._room(i) + 3.0:
                near.append(i)
        return near

    def _has_moved(self, column: int) -> bool:
        present = self.record.valid[:, column]
        x, y = self.record.x[present, column], self.record.y[present, column]
        return len(x) > 1 and float(x.max() - x.min() + y.max() - y.min()) >= MOVED_M

    def _room(self, column: int) -> float:
        e = self.record
        pair = np.array((self.ego, column))
        return float(portable.hypot(e.length[pair], e.width[pair]).sum()) / 2

    def _find_zone(self, column: int) -> ConflictZone | None:
        stations, ticks = self._find_window(column)
        if not len(stations) or not len(ticks):
            return None
        overlap = self._compute_overlaps(column, stations, ticks)
        if not overlap.any():
            return None
        first = int(np.flatnonzero(overlap.any(axis=1))[0])
        rows = slice(first, first + int(MAX_LENGTH_M / SPACING_M))
        top, bottom, left, right = find_largest_rectangle(overlap[rows])
        enter_m, leave_m = float(stations[rows][top]), float(stations[rows][bottom])
        x, y = self.motion.line.at(enter_m)
        point = round(x, 2), round(y, 2)
        return ConflictZone(column, enter_m, leave_m, int(ticks[left]), int(ticks[right]), point)

    def _find_window(self, column: int) -> tuple[Float, Int]:
        """Return the stations around the first place where boxes can touch, and the ticks at which they can there."""
        e, line = self.record, self.motion.line
        ticks = np.flatnonzero(e.valid[:, column])
        coarse = np.arange(0.0, line.length, 1.0)
        points = np.array([line.at(s) for s in coarse.tolist()])
        x, y = e.x[ticks, column][None, :], e.y[ticks, column][None, :]
        near = np.asarray(portable.hypot(x - points[:, :1], y - points[:, 1:]) < self._room(column))
        rows = np.flatnonzero(near.any(axis=1))
        if not len(rows):
            return np.zeros(0), ticks[:0]
        first = float(coarse[rows[0]])
        last = min(first + MAX_LENGTH_M + 2.0 * self._room(column), line.length)
        is_near = np.asarray(near[(coarse >= first) & (coarse <= last)].any(axis=0))
        begin = int(np.argmax(is_near))
        gone = np.flatnonzero(~is_near[begin:])
        end = begin + int(gone[0]) if len(gone) else len(is_near)
        return np.arange(first, last, SPACING_M), ticks[begin:end]

    def _compute_overlaps(self, column: int, stations: Float, ticks: Int) -> Bool:
        """Return (S, K) whether boxes overlap for all places of the CAV around a station.

        Those are within half a spacing along the route, and within `LATERAL_M` across.
        """
        e, line = self.record, self.motion.line
        shrink = 2.0 * (portable.hypot(SPACING_M / 2, LATERAL_M) + TURN_M)
        points = np.array([line.at(s) for s in stations.tolist()])
        mine = boxes_corners(
            points[:, 0],
            points[:, 1],
            line.yaws_at(stations),
            np.asarray(e.length[self.ego] - shrink),
            np.asarray(e.width[self.ego] - shrink),
        )
        theirs = boxes_corners(
            e.x[ticks, column],
            e.y[ticks, column],
            e.yaw[ticks, column],
            np.asarray(e.length[column]),
            np.asarray(e.width[column]),
        )
        return boxes_overlap(mine[:, None], theirs[None, :])


def find_largest_rectangle(mask: Bool) -> tuple[int, int, int, int]:
    """Return (top, bottom, left, right), all inclusive, of the first rectangle of True with the most cells.

    Raises ValueError for a mask without True.
    """
    heights = np.zeros(mask.shape[1] + 1, dtype=np.int64)
    best, rectangle = 0, None
    for row, cells in enumerate(mask):
        heights[:-1] = np.where(cells, heights[:-1] + 1, 0)
        stack: list[int] = []
        for column, height in enumerate(heights.tolist()):
            while stack and heights[stack[-1]] >= height:
                tall = int(heights[stack.pop()])
                left = stack[-1] + 1 if stack else 0
                if tall * (column - left) > best:
                    best, rectangle = tall * (column - left), (row - tall + 1, row, left, column - 1)
            stack.append(column)
    if rectangle is None:
        raise ValueError("expected a mask with a True cell, found none")
    return rectangle
