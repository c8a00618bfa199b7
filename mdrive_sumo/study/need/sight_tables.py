"""What is hidden between the stretches of a CAV's route and the ticks of another road user's drive.

Sensors measure at ticks, and the other road user starts whole ticks earlier or later, so its poses at ticks are those
of the recording. The CAV may be anywhere in a stretch. An entry of a table is True if anything of the one can be seen
from the other at any place of the stretch, so a pair with False is hidden.
"""

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import TICKS_PER_SECOND
from mdrive_sumo.episode import EpisodeRecord
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.study.need.conflict_zone import LATERAL_M, ConflictZone
from mdrive_sumo.study.need.motion import RouteMotion
from mdrive_sumo.study.need.occluders import SightBox, StandingOccluders, StandingVehicles, enclose_boxes

STRETCHES = ((15.0, 0.5), (45.0, 1.0), (1e9, 1.5))
"""(distance to the zone, length of a stretch) [m]: short ones where the decision falls, and none so
long that what is eroded by half of it is less than a car."""
FINE_TICKS = 5 * TICKS_PER_SECOND
"""Ticks before the road user has left the zone that are cells of their own; before them a cell has `COARSE_TICKS`."""
COARSE_TICKS = 10
"""Chosen: half a second, for what is seen long before the zone."""

Occluders = tuple[SightBox, ...]


@dataclass(frozen=True)
class SightTables:
    """Tables of one CAV and one road user: S stretches, K cells of ticks."""

    vehicles: StandingVehicles
    roads: RoadMap
    ego: int
    motion: RouteMotion
    zone: ConflictZone

    @property
    def record(self) -> EpisodeRecord:
        """The reference drive."""
        return self.vehicles.record

    @cached_property
    def edges(self) -> Float:
        """(S + 1,) stations [m] between stretches, from the start to the end of the zone."""
        edges, station = [self.zone.leave_m], self.zone.leave_m
        while station > 0.0:
            gap = max(self.zone.enter_m - station, 0.0)
            station -= next(length for distance, length in STRETCHES if gap < distance)
            edges.append(max(station, 0.0))
        return np.array(edges[::-1])

    def find_stretches(self, back_m: Float, front_m: Float) -> tuple[Int, Int]:
        """Return the first stretch and the one after the last that touch [back_m, front_m] [m], any shape."""
        last = len(self.edges) - 2
        begin = np.clip(np.searchsorted(self.edges, back_m, side="right") - 1, 0, last)
        return begin, np.clip(np.searchsorted(self.edges, front_m, side="right") - 1, begin, last) + 1

    @cached_property
    def first_tick(self) -> int:
        """First tick in which the road user exists."""
        return int(np.argmax(self.record.valid[:, self.zone.road_user]))

    @cached_property
    def _begins(self) -> Int:
        """(K + 1,) first tick of every cell, and the tick after the last."""
        end = self.zone.leave + 1
        fine = max(self.first_tick, end - FINE_TICKS)
        return np.concatenate((np.arange(self.first_tick, fine, COARSE_TICKS), np.arange(fine, end + 1)))

    def find_cells(self, ticks: Int) -> Int:
        """Return the cells of ticks of the road user's drive; the first one before it."""
        return np.maximum(np.searchsorted(self._begins, ticks, side="right") - 1, 0)

    @cached_property
    def cells(self) -> tuple[SightBox, ...]:
        """(K,) box around the road user in every cell."""
        e, i, ticks = self.record, self.zone.road_user, self._begins.tolist()
        size = float(e.length[i]), float(e.width[i])
        spans = [slice(begin, end) for begin, end in pairwise(ticks)]
        return tuple(enclose_boxes(e.x[t, i], e.y[t, i], e.yaw[t, i], *size) for t in spans)

    @cached_property
    def stretches(self) -> tuple[SightBox, ...]:
        """(S,) box around the CAV in every stretch."""
        e, line = self.record, self.motion.line
        size = float(e.length[self.ego]), float(e.width[self.ego]) + 2.0 * LATERAL_M
        boxes: list[SightBox] = []
        for begin, end in zip(self.edges[:-1].tolist(), self.edges[1:].tolist(), strict=True):
            stations = np.linspace(begin, end, 3)
            x, y = np.array([line.at(s) for s in stations.tolist()]).T
            boxes.append(enclose_boxes(x, y, line.yaws_at(stations), *size))
        return tuple(boxes)

    @cached_property
    def occluders(self) -> StandingOccluders:
        """What can stand between the two."""
        e, i = self.record, self.zone.road_user
        ticks = np.arange(self.first_tick, self.zone.leave + 1)
        stations = (*np.arange(0.0, self.zone.leave_m, 2.0).tolist(), self.zone.leave_m)
        route = np.array([self.motion.line.at(s) for s in stations])
        points = np.concatenate((route, np.stack((e.x[ticks, i], e.y[ticks, i]), axis=-1)))
        pair = np.array((self.ego, i))
        reach = float(portable.hypot(e.length[pair], e.width[pair]).max()) / 2 + 1.0
        region = shapely.MultiPoint(points).convex_hull.buffer(reach)
        return StandingOccluders(self.vehicles, self.roads, (self.ego, i), region)

    @cached_property
    def sets(self) -> tuple[Occluders, ...]:
        """The different sets of standing vehicles."""
        return tuple(dict.fromkeys(self._set_of_bin))

    @cached_property
    def _set_of_bin(self) -> tuple[Occluders, ...]:
        return tuple(self.occluders.list_by_bin())

    @cached_property
    def set_of_bin(self) -> Int:
        """(bins + 1,) index into `sets` for every bin of time; the last one for all times after the recording."""
        number = {occluders: i for i, occluders in enumerate(self.sets)}
        return np.array([number[occluders] for occluders in self._set_of_bin])

    @cached_property
    def _views(self) -> dict[tuple[int, int], Bool]:
        return {}

    @cached_property
    def _sums_from_route(self) -> dict[int, Int]:
        return {}

    @cached_property
    def _sums_from_drive(self) -> dict[int, Int]:
        return {}

    def sum_views_from_route(self, number: int) -> Int:
        """Return (S + 1, K): from how many stretches before each a cell can be seen, past the occluders of that set."""
        if number not in self._sums_from_route:
            rows = np.array([self.look_from_route(row, number) for row in range(len(self.edges) - 1)])
            self._sums_from_route[number] = np.cumsum(np.pad(rows.astype(np.int64), ((1, 0), (0, 0))), axis=0)
        return self._sums_from_route[number]

    def look_from_route(self, row: int, number: int) -> Bool:
        """Return (K,) the cells that can be seen from a stretch, past the occluders of that set."""
        key = number, row
        if key not in self._views:
            self._views[key] = self._look_from_route(row, self.sets[number])
        return self._views[key]

    def _look_from_route(self, row: int, occluders: Occluders) -> Bool:
        begin, end = self.edges[row], self.edges[row + 1]
        eye = self.motion.line.at(float(begin + end) / 2)
        erosion = float(portable.hypot(float(end - begin) / 2, LATERAL_M))
        return self.occluders.find_visible(eye, erosion, occluders, self.cells)

    def sum_views_from_drive(self, number: int) -> Int:
        """Return (T, S + 1): how many stretches before each the road user sees at a tick of its drive.

        Rows are ticks from `first_tick` to the end of the zone.
        """
        if number not in self._sums_from_drive:
            e, i = self.record, self.zone.road_user
            ticks = range(self.first_tick, self.zone.leave + 1)
            eyes = [(float(e.x[tick, i]), float(e.y[tick, i])) for tick in ticks]
            # A road user that waits looks from one place.
            seen = {
                eye: self.occluders.find_visible(eye, 0.0, self.sets[number], self.stretches)
                for eye in dict.fromkeys(eyes)
            }
            rows = np.array([seen[eye] for eye in eyes])
            self._sums_from_drive[number] = np.cumsum(np.pad(rows.astype(np.int64), ((0, 0), (1, 0))), axis=1)
        return self._sums_from_drive[number]
