"""Speed limits of the moving scripted actors that avoid collisions; cycles of waiting actors are broken."""

import numpy as np

from mdrive_sumo.actors.actor_surroundings import ActorSurroundings
from mdrive_sumo.actors.look_ahead import FreeSpeeds, LookAhead, compute_free_speeds
from mdrive_sumo.actors.motion_state import ActorParams, MotionState
from mdrive_sumo.actors.path_tables import PathPoints, PathTables
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int

WAITING_SPEED = 0.1
"""An actor that is blocked and no faster than this [m/s] counts as waiting for its blocker."""
HEAD_ON_COS = -0.95
"""Two vehicles whose headings have a lower cosine face each other, and neither proceeds; a pedestrian walks around."""


class CollisionAvoidance:
    """Limits the speed of movers by what is on their path; caches their relations until the set of actors changes."""

    def __init__(self, avoids_collisions: Bool, is_pedestrian: Bool, params: ActorParams) -> None:
        """All (M,) over the moving scripted actors."""
        self._avoids_collisions, self._is_pedestrian, self._params = avoids_collisions, is_pedestrian, params
        self._known_movers: Int | None = None
        self._considers: Bool
        self._yields: Bool

    def compute_speed_limits(
        self,
        state: MotionState,
        points: PathPoints,
        present: Bool,
        is_on_log: Bool,
        surroundings: ActorSurroundings,
        tables: PathTables,
    ) -> Float:
        """Return the (M,) greatest speeds [m/s]; infinite where the path is free.

        `is_on_log` (M,): replays at the pose of their log. They ignore each other, because the log is consistent.
        """
        limit = np.full(len(points.x), np.inf)
        arrived = (points.s >= tables.length) & ~self._params.is_timed
        rows = np.flatnonzero(self._avoids_collisions & present & ~arrived)
        if not len(rows):
            return limit
        self._update_relations(surroundings)
        considers, yields = self._considers[rows], self._yields[rows]
        settled = np.append(is_on_log, False)[surroundings.mover_index]  # index -1: everything that is no mover
        considers = considers & ~(is_on_log[rows, None] & settled)
        look_ahead = self._build_look_ahead(rows, state, points)
        free = compute_free_speeds(look_ahead, considers, yields, surroundings, tables)
        limit[rows] = free.speed
        breakers = self._find_deadlock_breakers(rows, free, state, points, surroundings)
        if breakers.any():  # they proceed as if there were no other movers
            chosen = self._build_look_ahead(rows[breakers], state, points)
            free = compute_free_speeds(
                chosen, considers[breakers] & (surroundings.mover_index < 0), yields[breakers], surroundings, tables
            )
            limit[rows[breakers]] = free.speed
        return limit

    def _update_relations(self, surroundings: ActorSurroundings) -> None:
        if self._known_movers is surroundings.mover_index:
            return
        self._known_movers = surroundings.mover_index
        own_index = np.arange(len(self._avoids_collisions))[:, None]
        both_on_foot = self._is_pedestrian[:, None] & surroundings.is_pedestrian  # pedestrians walk around each other
        in_log = self._params.is_timed[:, None] & surroundings.is_static  # the logged vehicle passed the static object
        self._considers = (surroundings.mover_index != own_index) & ~both_on_foot & ~in_log
        ours = surroundings.mover_index >= 0
        self._yields = (
            (self._params.prediction_s > 0)[:, None]
            & ours
            & (surroundings.is_pedestrian | (surroundings.mover_index < own_index))
        )

    def _build_look_ahead(self, rows: Int, state: MotionState, points: PathPoints) -> LookAhead:
        fit = self._params
        speed = state.speed[rows]
        return LookAhead(
            rows,
            points.x[rows],
            points.y[rows],
            points.s[rows],
            speed * speed / (2.0 * fit.comfort_brake[rows]) + fit.gap[rows] + fit.look_margin[rows],
            fit.half_length[rows],
            fit.half_width[rows] + fit.clearance[rows],
            fit.gap[rows],
            fit.comfort_brake[rows],
            fit.prediction_s[rows],
        )

    def _find_deadlock_breakers(
        self, rows: Int, free: FreeSpeeds, state: MotionState, points: PathPoints, surroundings: ActorSurroundings
    ) -> Bool:
        """Return an (R,) mask of the movers that proceed in a cycle of waiting ones: a pedestrian first, else by id."""
        is_breaker = np.zeros(len(rows), dtype=np.bool_)
        waiting = (free.blocker >= 0) & (free.speed < WAITING_SPEED) & (state.speed[rows] < WAITING_SPEED)
        waiting &= surroundings.mover_index[free.blocker] >= 0
        waits = dict(zip(rows[waiting].tolist(), surroundings.mover_index[free.blocker[waiting]].tolist(), strict=True))
        for i in np.flatnonzero(waiting).tolist():
            row = int(rows[i])
            ring = _find_wait_cycle(row, waits)
            if not ring or row != min(ring, key=lambda one: (not self._is_pedestrian[one], one)):
                continue
            is_breaker[i] = (
                self._is_pedestrian[row] or portable.cos(points.yaw[row] - points.yaw[waits[row]]) > HEAD_ON_COS
            )
        return is_breaker


def _find_wait_cycle(start: int, waits: dict[int, int]) -> list[int]:
    """Return the cycle of waiting movers that contains `start`; empty if there is none."""
    ring = [start]
    while ring[-1] in waits:
        after = waits[ring[-1]]
        if after == start:
            return ring
        if after in ring:
            break
        ring.append(after)
    return []
