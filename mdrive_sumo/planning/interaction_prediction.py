"""What one who only sees the others expects them to do: time-to-conflict, right of way, and a safe distance."""

import math

import numpy as np

from mdrive_sumo.contract import Briefing, Objects, OwnState
from mdrive_sumo.core.geometry import Float, wrap_angle
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning import right_of_way
from mdrive_sumo.planning.motion_prediction import (
    FORESIGHT_S,
    STANDING_SPEED,
    TIMES,
    Motion,
    along_path,
    giving_way,
    going,
    hesitating,
    on_circle,
    steady,
    top_speed,
)
from mdrive_sumo.planning.path import SPACING_M, Path
from mdrive_sumo.planning.space_time_planner import CHECK_TICKS, Barrier, Planner

ACCELERATION = 2.0
PATIENCE_S = (2.0, 8.0)
"""Who has stood so long for others (everyone draws its own patience) insists on its turn for `BOLD_S`: four polite
drivers would wait for each other for ever."""
BOLD_S = 3.0
CROSSING_MARGIN_M = 2.0
"""Waits so far before the place that both would use, at the least."""
TURNING_ROOM_M = 6.0
"""Room for one who turns towards me where I expected him to go straight on."""
HARD_BRAKING = 4.0
"""[m/s2] As hard as the planner can brake."""
BEYOND_STOP_M = 0.5
"""A wait begins no nearer than this behind where the car could stop."""
SAME_WAY = math.radians(45)
SEEN_ROWS = int((TIMES <= FORESIGHT_S).sum())


class Foresight:
    """The others' motions as a careful driver expects them, who knows no intentions.

    Whoever is there before me goes first and is expected to go on as he does; whoever is there after me, to brake for
    me. Who drives ahead of me may brake at any time.
    """

    def __init__(self, briefing: Briefing, cruise: float) -> None:
        self._me, self._cruise = briefing, cruise
        self._memory = right_of_way.Memory()
        self._given_way: frozenset[str] = frozenset()
        self._waited_s = 0.0
        self._patience_s = float(np.random.default_rng(briefing.seed).uniform(*PATIENCE_S))

    def outlook(self, own: OwnState, objects: Objects, planner: Planner) -> tuple[list[Motion], list[Barrier]]:
        """Where everybody who matters will be, and where to wait for those who go first."""
        me = right_of_way.Mover((own.x, own.y), max(own.speed, 0.0), self._cruise, ACCELERATION)
        ahead = right_of_way.outlook(planner.path, planner.s, self._me.vehicle)
        curvature = self._memory.curvature(objects, CHECK_TICKS * self._me.tick_s)
        on_way = right_of_way.rows_on_way(me, ahead, objects).tolist()
        found = [self._leader(objects, row, planner.path, planner.s) for row in on_way]
        mind_me, along = right_of_way.beside(me, ahead, objects), right_of_way.same_way(ahead, objects)
        rows = {name: row for row, name in enumerate(objects.ids) if row not in on_way and not mind_me[row]}
        crossings = [c for c in right_of_way.crossings(ahead, objects, curvature) if c.first > 0 and c.id in rows]
        first = self._first(me, [c for c in crossings if not along[rows[c.id]]])
        for crossing in crossings:
            row = rows[crossing.id]
            if along[row]:
                found.append(_merging(objects, row, float(curvature[row])))
            else:
                found.append(_crossing(objects, row, float(curvature[row]), crossing.id in first))
        return found, [barrier for c in crossings if c.id in first for barrier in _before(c, me, planner.s)]

    def _leader(self, objects: Objects, row: int, path: Path, s: float) -> Motion:
        """One who is on my path now."""
        speed = float(objects.speed[row])
        here = path.project(
            float(objects.x[row]), float(objects.y[row]), s + right_of_way.LOOK_M / 2, right_of_way.LOOK_M
        )
        way = float(np.interp(here, np.arange(len(path.xy)) * SPACING_M, path.yaw))
        if abs(speed) > STANDING_SPEED and abs(wrap_angle(float(objects.yaw[row]) - way)) < SAME_WAY:
            return _motion(objects, row, along_path(path, here, giving_way(speed)), stands=True)
        return _motion(objects, row, on_circle(objects, row, giving_way(speed), 0.0), stands=True)

    def _first(self, me: right_of_way.Mover, crossings: list[right_of_way.Crossing]) -> frozenset[str]:
        """Who goes before me."""
        bold = self._waited_s > self._patience_s
        first = [c.id for c in crossings if right_of_way.gives_way(me, c, c.id in self._given_way, bold)]
        self._given_way = frozenset(first)
        if bold or (first and me.speed < right_of_way.MOVING_SPEED):
            self._waited_s += CHECK_TICKS * self._me.tick_s
        if self._waited_s > self._patience_s + BOLD_S:
            self._waited_s = 0.0
        return self._given_way


def _before(crossing: right_of_way.Crossing, me: right_of_way.Mover, s: float) -> list[Barrier]:
    """Where to wait for one who goes first, if I can still stop there."""
    stop_m = me.speed**2 / (2 * HARD_BRAKING)
    if crossing.first - CROSSING_MARGIN_M < stop_m:
        return []
    gap = max(crossing.first - TURNING_ROOM_M, min(stop_m + BEYOND_STOP_M, crossing.first - CROSSING_MARGIN_M))
    return [Barrier(s + gap, crossing.leaves_s)]


def _merging(objects: Objects, row: int, curvature: float) -> Motion:
    """One before me whose way comes into mine."""
    speed = float(objects.speed[row])
    return _between(objects, row, (hesitating(speed), steady(speed)), curvature)


def _crossing(objects: Objects, row: int, curvature: float, first: bool) -> Motion:
    """One whose way crosses mine."""
    speed = float(objects.speed[row])
    if not first:
        return _motion(objects, row, on_circle(objects, row, giving_way(speed), curvature), stands=True)
    if objects.kind[row] == Kind.STATIC:
        return _motion(objects, row, on_circle(objects, row, steady(0.0), 0.0), stands=True)
    return _between(objects, row, (hesitating(speed), going(speed, top_speed(objects, row))), curvature)


def _between(objects: Objects, row: int, ways: tuple[Float, Float], curvature: float) -> Motion:
    """One who will have travelled something between the two ways (T,) [m]: its box covers them all."""
    least, most = ways
    middle = on_circle(objects, row, (most + least) / 2, curvature)[:SEEN_ROWS]
    length = float(objects.length[row]) + (most - least)[:SEEN_ROWS]
    return Motion(middle, length, float(objects.width[row]))


def _motion(objects: Objects, row: int, poses: Float, stands: bool = False) -> Motion:
    return Motion(poses, float(objects.length[row]), float(objects.width[row]), stands)
