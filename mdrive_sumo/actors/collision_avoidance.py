"""The watch: how fast each mover may go for what is in its way. Nobody waits for one that waits for it."""

import numpy as np

from mdrive_sumo.actors.actor_surroundings import Around
from mdrive_sumo.actors.look_ahead import Lookers, Way, free_way
from mdrive_sumo.actors.motion_state import Fitness, Going
from mdrive_sumo.actors.path_tables import Places, Tables
from mdrive_sumo.core.geometry import Bool, Float, Int

CREEPS = 0.1
"""Who goes no faster [m/s] waits for what is in his way."""
HEAD_ON = -0.95
"""Two vehicles whose headings have a lower cosine stand face to face, and neither goes on; a walker walks around."""


class Watch:
    """The eyes of those that avoid collisions; remembers who minds whom while nobody comes or goes."""

    def __init__(self, watchful: Bool, on_foot: Bool, fitness: Fitness) -> None:
        """(M,) each."""
        self._watchful, self._on_foot, self._fitness = watchful, on_foot, fitness
        self._known: Int | None = None
        self._minds: Bool
        self._yields: Bool

    def limits(self, going: Going, here: Places, present: Bool, on_time: Bool, around: Around, tables: Tables) -> Float:
        """(M,) greatest speed [m/s]; infinite where the way is free.

        `on_time` (M,): replays that are where their log has them; among themselves the log has settled everything.
        """
        limit = np.full(len(here.x), np.inf)
        arrived = (here.s >= tables.length) & ~self._fitness.timed  # and need not look any more
        rows = np.flatnonzero(self._watchful & present & ~arrived)
        if not len(rows):
            return limit
        self._look_who_is_there(around)
        wary, yields = self._minds[rows], self._yields[rows]
        settled = np.append(on_time, False)[around.mover]  # the last one is of those who are no mover
        wary = wary & ~(on_time[rows, None] & settled)
        lookers = self._lookers(rows, going, here)
        way = free_way(lookers, wary, yields, around, tables)
        limit[rows] = way.speed
        loops = self._loops(rows, way, going, here, around)
        if loops.any():  # those go on as if nobody of theirs were there
            some = self._lookers(rows[loops], going, here)
            way = free_way(some, wary[loops] & (around.mover < 0), yields[loops], around, tables)
            limit[rows[loops]] = way.speed
        return limit

    def _look_who_is_there(self, around: Around) -> None:
        if self._known is around.mover:
            return
        self._known = around.mover
        me = np.arange(len(self._watchful))[:, None]
        both_on_foot = self._on_foot[:, None] & around.on_foot  # people walk around each other
        in_log = self._fitness.timed[:, None] & around.still  # the log went past what stands
        self._minds = (around.mover != me) & ~both_on_foot & ~in_log
        ours = around.mover >= 0
        self._yields = (self._fitness.foresight > 0)[:, None] & ours & (around.on_foot | (around.mover < me))

    def _lookers(self, rows: Int, going: Going, here: Places) -> Lookers:
        fit = self._fitness
        speed = going.speed[rows]
        return Lookers(
            rows,
            here.x[rows],
            here.y[rows],
            here.s[rows],
            speed * speed / (2.0 * fit.brake[rows]) + fit.gap[rows] + fit.look[rows],
            fit.half_length[rows],
            fit.half_width[rows] + fit.clearance[rows],
            fit.gap[rows],
            fit.brake[rows],
            fit.foresight[rows],
        )

    def _loops(self, rows: Int, way: Way, going: Going, here: Places, around: Around) -> Bool:
        """(R,) which lookers go first of a ring of movers that all wait for the next one: who walks, then by id."""
        found = np.zeros(len(rows), dtype=np.bool_)
        waiting = (way.blocker >= 0) & (way.speed < CREEPS) & (going.speed[rows] < CREEPS)
        waiting &= around.mover[way.blocker] >= 0
        waits = dict(zip(rows[waiting].tolist(), around.mover[way.blocker[waiting]].tolist(), strict=True))
        for i in np.flatnonzero(waiting).tolist():
            row = int(rows[i])
            ring = _ring(row, waits)
            if not ring or row != min(ring, key=lambda one: (not self._on_foot[one], one)):
                continue
            found[i] = self._on_foot[row] or np.cos(here.yaw[row] - here.yaw[waits[row]]) > HEAD_ON
        return found


def _ring(start: int, waits: dict[int, int]) -> list[int]:
    """Those who wait for each other, from `start` on until it comes back; empty if it does not."""
    ring = [start]
    while ring[-1] in waits:
        after = waits[ring[-1]]
        if after == start:
            return ring
        if after in ring:
            break
        ring.append(after)
    return []
