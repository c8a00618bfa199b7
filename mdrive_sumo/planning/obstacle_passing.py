"""When a driver leaves its path for what stands on it, and where it waits until it can."""

import math
from collections.abc import Sequence

import numpy as np

from mdrive_sumo.contract import Briefing, Objects, Observation, OwnState
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners
from mdrive_sumo.core.state import TICKS_PER_SECOND, Kind
from mdrive_sumo.perception.static_object_tracker import Standing
from mdrive_sumo.planning.detour import LOOK_M, Detour, around, in_the_way, spans
from mdrive_sumo.planning.path_overlap import cells_of, footprints, overlaps
from mdrive_sumo.planning.space_time_planner import Barrier, Planner

SURE_S = 1.0
"""So long something must have been seen: a false positive is gone sooner."""
DOUBTED_S, PARKED_S = 2.0, 10.0
"""A car that stands for so long is given room to turn out behind it; is parked."""
BUSY_M, MOVING_SPEED = 8.0, 1.0
"""A car that stands that near somebody who moves [m/s] may wait for him."""
TURN_OUT_M = 10.0
"""Room before an obstacle in which a standing car can turn out to its side."""
HARD_BRAKING = 4.0
LATE_M = 4.0
"""Who would stop that much too late for turning out drives up to it."""
SLOW, ACCELERATION = 4.0, 2.0
"""[m/s, m/s2] At least so fast a car passes an obstacle, and so it comes to that speed."""
IN_HAND_S = 2.0
"""The way past an obstacle must be free for so much longer than it takes."""
STRIDE_M = 0.5
STRIDES: Float = np.arange(0.0, 80.0, 2.0)
"""[m] How far others are expected to go straight on."""
LOOK_TICKS = 3 * TICKS_PER_SECOND // 2
"""The way must be seen to be free for so long: detectors miss things for half a second, and one hides another."""
CREEPING = 1.5
"""[m/s] Who is slower can still stop."""
ROOM_M = 3.0
"""Between me and the way of somebody whom I let through."""
SIDE_M = 0.3
SAME_WAY = math.cos(math.radians(60))
LANE_M = 1.5
"""Who is behind me and nearer to my line than that follows me."""


class Passing:
    """The obstacles on one's way, which parked cars one goes around, and how."""

    def __init__(self, briefing: Briefing) -> None:
        self._me = briefing.vehicle
        self._briefing = briefing
        self._standing = Standing()
        self._passed: frozenset[str] = frozenset()
        self._detour: Detour | None = None
        self._clashed = -LOOK_TICKS, math.inf

    def step(
        self, seen: Observation, objects: Objects, planner: Planner, halts: Sequence[float]
    ) -> tuple[Objects, list[Barrier]]:
        """Diverts the planner if it should; returns the objects as they are best known, and where to wait.

        halts: arc lengths [m] of red lights and stop signs: a car that stands before one is not parked.
        """
        self._standing.look(seen.tick, objects)
        objects = self._standing.recalled(seen.tick, objects, SURE_S)
        stood_s = self._standing.seconds(objects)
        fixed = self._fixed(objects, stood_s)
        objects = self._standing.settled(objects, fixed)
        waits = self._oncoming(seen.tick, objects.take(~fixed), seen.own, planner)
        boxes = boxes_corners(objects.x, objects.y, objects.yaw, objects.length, objects.width)
        busy = _busy(objects, stood_s)
        # Whoever has not moved yet may be parked, busy or not: too near to him nobody can turn out any more.
        doubted = ~busy | self._standing.unmoved(objects)
        still = (objects.kind == Kind.VEHICLE) & (stood_s >= DOUBTED_S) & doubted
        struck = (fixed | still) & in_the_way(planner.path, planner.s, boxes, self._me)
        if not struck.any():
            return objects, waits
        first = spans(planner.path, planner.s, boxes)[:, 0]
        still &= ~np.array([any(s < line < s + LOOK_M for line in halts) for s in first], dtype=np.bool_)
        parked = fixed | (struck & still & ~busy & (stood_s >= PARKED_S))
        if self._diverted(seen.own, objects, parked, boxes, planner):
            return self._standing.settled(objects, parked), waits
        return objects, waits + self._waiting(first[struck & (fixed | still)], planner.s, seen.own.speed)

    def _fixed(self, objects: Objects, stood_s: Float) -> Bool:
        """(N,) what is no car, or one that I go around."""
        passed = np.array([name in self._passed for name in objects.ids], dtype=np.bool_)
        return ((objects.kind == Kind.STATIC) | passed) & (stood_s >= SURE_S)

    def _diverted(self, own: OwnState, objects: Objects, parked: Bool, boxes: Float, planner: Planner) -> bool:
        """Whether there is a way around what is parked, and free; it is taken then."""
        detour = around(planner.path, planner.s, max(own.speed, 0.0), boxes[parked], self._briefing)
        if detour is None or math.isfinite(self._clash(detour, objects.take(~parked), own, planner.s, IN_HAND_S)):
            return False
        planner.divert(detour.path)
        last = max(detour.last, self._detour.last) if self._detour else detour.last
        self._detour = detour._replace(last=last)
        self._passed |= {name for name, one in zip(objects.ids, parked.tolist(), strict=True) if one}
        return True

    def _oncoming(self, tick: int, others: Objects, own: OwnState, planner: Planner) -> list[Barrier]:
        """Before others' way on the detour, while I am not in it: they go first."""
        if self._detour is None or planner.s > self._detour.last:
            return []
        clash = self._clash(self._detour, others, own, planner.s, IN_HAND_S / 2)
        if clash < math.inf:
            self._clashed = tick, clash
        elif tick - self._clashed[0] <= LOOK_TICKS:
            clash = self._clashed[1]
        soonest = planner.s + own.speed**2 / (2 * HARD_BRAKING)
        stops = own.speed < CREEPING or soonest < clash
        return [Barrier(max(clash - ROOM_M, soonest))] if stops and clash < math.inf else []

    def _clash(self, detour: Detour, others: Objects, own: OwnState, s: float, in_hand_s: float) -> float:
        """Where [m] on the detour ahead of s the way of somebody begins who will have been or be there when I come, if
        all go straight on; infinity if there is nobody.
        """
        stations = np.arange(s, detour.last, STRIDE_M)
        size = self._me.length, self._me.width + 2 * SIDE_M
        mine = footprints(detour.path, *size, cells_of(detour.path, stations))
        rows = np.flatnonzero(~_harmless(others, own))
        speed = np.where(others.speed[rows] > MOVING_SPEED, others.speed[rows], 0.0)[:, None]
        arrives_s = np.where(speed > 0, STRIDES / np.maximum(speed, MOVING_SPEED), 0.0)
        swept = _swept(others, rows, speed)
        met = overlaps(mine, swept.reshape(-1, 4, 2)).reshape(len(mine), len(rows), len(STRIDES))
        my_s = (stations - s) / max(own.speed, SLOW) + max(SLOW - own.speed, 0.0) / (2 * ACCELERATION)
        clash = met & (arrives_s <= my_s[:, None, None] + in_hand_s)
        way = met[:, clash.any((0, 2))].any((1, 2))
        return float(stations[way.argmax()]) if way.any() else math.inf

    def _waiting(self, first: Float, s: float, speed: float) -> list[Barrier]:
        """Before what begins at arc lengths first (K,) [m]: far enough to turn out, if one can still stop there."""
        if not len(first):
            return []
        stop = float(first.min()) - self._me.length / 2 - TURN_OUT_M
        soonest = s + speed**2 / (2 * HARD_BRAKING)
        return [Barrier(max(stop, soonest))] if soonest < stop + LATE_M else []


def _busy(objects: Objects, stood_s: Float) -> Bool:
    """(N,) who has somebody near who moves."""
    moves = np.flatnonzero((stood_s < DOUBTED_S) & (np.abs(objects.speed) > MOVING_SPEED))
    gaps = np.hypot(objects.x[:, None] - objects.x[moves], objects.y[:, None] - objects.y[moves])
    return np.any(gaps < BUSY_M, axis=1)


def _swept(others: Objects, rows: Int, speed: Float) -> Float:
    """Corners (R, D, 4, 2) of boxes moved straight on by `STRIDES`; who has no speed (R, 1) stays."""
    yaw = others.yaw[rows, None]
    gone = np.where(speed > 0, STRIDES, 0.0)
    x, y = others.x[rows, None] + gone * np.cos(yaw), others.y[rows, None] + gone * np.sin(yaw)
    return boxes_corners(x, y, yaw, others.length[rows, None], others.width[rows, None])


def _harmless(others: Objects, own: OwnState) -> Bool:
    """(N,) who drives ahead of me my way, or follows me."""
    dx, dy = others.x - own.x, others.y - own.y
    lead = dx * math.cos(own.yaw) + dy * math.sin(own.yaw)
    aside = dy * math.cos(own.yaw) - dx * math.sin(own.yaw)
    leads = (lead > 0) & (others.speed > MOVING_SPEED)
    follows = (lead < 0) & (np.abs(aside) < LANE_M)
    return (np.cos(others.yaw - own.yaw) > SAME_WAY) & (leads | follows)
