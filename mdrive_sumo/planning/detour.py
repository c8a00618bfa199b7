"""A way around what stands in the way: the same path, shifted to one side for as long as it must be."""

import math
from typing import NamedTuple

import numpy as np

from mdrive_sumo.contract import Briefing, VehicleFacts
from mdrive_sumo.core.geometry import Bool, Float, Int, build_polyline
from mdrive_sumo.planning.path import SPACING_M, Path, curve_speeds, path_through
from mdrive_sumo.planning.path_overlap import cells_of, footprints, overlaps

LOOK_M = 40.0
"""Whatever stands further ahead is left for later."""
SIDE_M = 0.25
"""What would be passed by less than this is in the way."""
CLEARANCE_M = 0.5
"""Kept from what is passed, sideways."""
ALONG_M = 1.0
"""So long before and behind it the shift is whole."""
EDGE_M = 0.2
"""Kept from the edge of the road."""
LEAST_RAMP_M = 12.0
"""The shift grows over this at least where there is room for it."""
LATERAL, BRAKING = 2.0, 3.0
"""[m/s2] A ramp is so long that nobody is pushed aside harder; before a shorter one a car must be able to slow down."""
SHARPEST = 0.18
"""[1/m] No ramp bends more: a radius of 5.5 m."""
PEAK = 10 / math.sqrt(3)
"""Greatest second derivative of the quintic step 10 u³ - 15 u⁴ + 6 u⁵."""
EXTRA_M = (0.0, 0.25, 0.5, 0.75, 1.0)
"""A car takes up more room in bends and while it turns than its width."""
SHIFTED_M = 0.1


class Detour(NamedTuple):
    """A path, and between which arc lengths [m] on it it is another one than before."""

    path: Path
    first: float
    last: float


class _Shift(NamedTuple):
    """Sideways by `left` [m] between two arc lengths [m], after and before ramps of those lengths [m]."""

    left: float
    hold: tuple[float, float]
    ramps: tuple[float, float]

    def at(self, s: Float) -> Float:
        """(M,) [m] at arc lengths s (M,)."""
        rise = (s - self.hold[0] + self.ramps[0]) / self.ramps[0]
        fall = (self.hold[1] + self.ramps[1] - s) / self.ramps[1]
        u = np.clip(np.minimum(rise, fall), 0.0, 1.0)
        return self.left * u**3 * (10 - 15 * u + 6 * u**2)


def in_the_way(path: Path, s: float, boxes: Float, vehicle: VehicleFacts) -> Bool:
    """(K,) which boxes, corners (K, 4, 2) [m], a car touches within `LOOK_M` if it goes on along its path."""
    cells = cells_of(path, np.arange(s, min(s + LOOK_M, path.length), 2 * SPACING_M))
    return np.any(overlaps(footprints(path, vehicle.length, vehicle.width + 2 * SIDE_M, cells), boxes), axis=0)


def spans(path: Path, s: float, boxes: Float) -> Float:
    """(K, 4) where boxes (K, 4, 2) [m] lie along the path near s: first and last arc length, rightmost and leftmost
    distance from it [m], left positive.
    """
    window = slice(max(int((s - LOOK_M) / SPACING_M), 0), int((s + 2 * LOOK_M) / SPACING_M))
    i, along, left = _frenet(path.xy[window], path.yaw[window], boxes)
    stations = (window.start + i) * SPACING_M + along
    return np.column_stack((stations.min(1), stations.max(1), left.min(1), left.max(1)))


def _frenet(xy: Float, yaw: Float, points: Float) -> tuple[Int, Float, Float]:
    """Of points (..., 2): the nearest of the chain xy (N, 2), and how far ahead and to the left of it they lie [m]."""
    i = ((points[..., None, :] - xy) ** 2).sum(-1).argmin(-1)
    gap = points - xy[i]
    cos, sin = np.cos(yaw[i]), np.sin(yaw[i])
    return i, gap[..., 0] * cos + gap[..., 1] * sin, gap[..., 1] * cos - gap[..., 0] * sin


def around(path: Path, s: float, speed: float, boxes: Float, me: Briefing) -> Detour | None:
    """The least shift of the path ahead of s [m] that passes the boxes, corners (K, 4, 2) [m], that stand on it.

    It passes them with `CLEARANCE_M`, keeps the car on the road (`EDGE_M` from its edge), bends no more than
    `SHARPEST`, and a car of that speed [m/s] can slow down to it. None if nothing is in the way or no shift will do.
    """
    struck = in_the_way(path, s, boxes, me.vehicle)
    if not struck.any() or not len(me.route_room):
        return None
    search = _Search(path, s, speed, boxes, me)
    nearest = struck & (search.where[:, 0] == search.where[struck, 0].min())
    return search.least(struck) or search.least(nearest)  # what stands behind the nearest may be passed later


class _Search:
    """The ways around some boxes."""

    def __init__(self, path: Path, s: float, speed: float, boxes: Float, me: Briefing) -> None:
        self._path, self._s, self._speed, self._boxes, self._me = path, s, speed, boxes, me
        self.where = spans(path, s, boxes)

    def least(self, group: Bool) -> Detour | None:
        """The least shift that passes the group (K,) and whatever else that brings into the way."""
        shifts = [self._beyond(group, side, extra) for side in (1, -1) for extra in EXTRA_M]
        best, least = None, math.inf
        for shift in sorted(shifts, key=lambda shift: abs(shift.left)):
            if abs(shift.left) < least and (found := self._tried(shift, group)) is not None:
                detour, aside = found
                best, least = (detour, aside) if aside < least else (best, least)
        return best

    def _beyond(self, group: Bool, side: int, extra: float) -> _Shift:
        first, last, right, left = self.where[group].T
        gap = side * self._me.vehicle.width / 2 + side * (CLEARANCE_M + extra)
        aside = gap + (float(left.max()) if side > 0 else float(right.min()))
        half = self._me.vehicle.length / 2 + ALONG_M
        hold = float(first.min()) - half, float(last.max()) + half
        wanted = max(self._speed * math.sqrt(PEAK * abs(aside) / LATERAL), LEAST_RAMP_M)
        return _Shift(aside, hold, (min(wanted, hold[0] - self._s), wanted))

    def _tried(self, shift: _Shift, group: Bool) -> tuple[Detour, float] | None:
        """The path shifted so, or further if that brings more into the way, and how far [m]; None if it will not do."""
        while shift.ramps[0] > 0:
            detour = _shifted(self._path, shift, self._me.vehicle)
            if not self._drivable(detour):
                return None
            more = self._struck(detour) & ~group
            if not more.any():
                return (detour, abs(shift.left)) if not self._struck(detour).any() else None
            group = group | more
            shift = self._beyond(group, 1 if shift.left > 0 else -1, 0.0)
        return None

    def _struck(self, detour: Detour) -> Bool:
        """(K,) which boxes it comes too close to; a little less than wanted, for corners are rounded."""
        size = self._me.vehicle.length + ALONG_M / 2, self._me.vehicle.width + 2 * CLEARANCE_M - 0.1
        return np.any(overlaps(footprints(detour.path, *size, _cells(detour, 1)), self._boxes), axis=0)

    def _drivable(self, detour: Detour) -> bool:
        """Whether the bends are wide enough, the speed is low enough and the car stays on the road."""
        path, cells = detour.path, _cells(detour, 1)
        if np.abs(path.curvature[cells]).max() > SHARPEST:
            return False
        here = cells_of(path, np.array((self._s,)))
        if curve_speeds(path, self._me.vehicle.max_speed, BRAKING, BRAKING)[here][0] < self._speed:
            return False
        return self._on_road(detour)

    def _on_road(self, detour: Detour) -> bool:
        """Whether the car's corners stay on the road wherever the path has been shifted."""
        me, cells = self._me, _cells(detour, 2)
        aside = np.abs(_frenet(self._path.xy, self._path.yaw, detour.path.xy[cells])[2])
        corners = footprints(detour.path, me.vehicle.length, me.vehicle.width, cells[aside > SHIFTED_M])
        near = slice(max(int(detour.first) - 10, 0), int(detour.last) + 20)
        i, _, left = _frenet(me.route_xy[near], me.route_yaw[near], corners)
        room = _least_of_three(me.route_room[near])[i] - EDGE_M
        return bool(((left <= room[..., 0]) & (-left <= room[..., 1])).all())


def _cells(detour: Detour, stride: int) -> Int:
    return cells_of(detour.path, np.arange(detour.first, detour.last, stride * SPACING_M))


def _least_of_three(room: Float) -> Float:
    """(N, 2) the least of each row and its neighbours: edges of the road are known at every metre only."""
    padded = np.concatenate((room[:1], room, room[-1:]))
    return np.minimum(np.minimum(padded[:-2], padded[1:-1]), padded[2:])


def _shifted(path: Path, shift: _Shift, vehicle: VehicleFacts) -> Detour:
    left = shift.at(np.arange(len(path.xy), dtype=np.float64) * SPACING_M)
    moved = path.xy + left[:, None] * np.column_stack((-np.sin(path.yaw), np.cos(path.yaw)))
    way = build_polyline(moved)
    old = np.arange(len(way.s)) * SPACING_M
    goal, first, last = np.interp(
        (path.goal_s, shift.hold[0] - shift.ramps[0], shift.hold[1] + shift.ramps[1]), old, way.s
    ).tolist()
    xy = way.resampled(SPACING_M).xy[:-1]
    return Detour(path_through(xy, vehicle.rear_to_centre, float(path.body_yaw[0]), goal), first, last)
