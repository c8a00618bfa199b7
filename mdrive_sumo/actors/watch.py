"""The watch: how fast each mover may go for what is in its way. Nobody waits for one that waits for it."""

import numpy as np

from mdrive_sumo.actors.ahead import Lookers, Way, free_way
from mdrive_sumo.actors.around import Around
from mdrive_sumo.actors.motion import Fitness, Going
from mdrive_sumo.actors.tables import Places, Tables
from mdrive_sumo.geometry import Bool, Float, Int

HEAD_ON = -0.7
"""Two whose headings have a lower cosine stand face to face; neither can go on, whoever has priority."""


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
        rows = np.flatnonzero(self._watchful & present)
        if not len(rows):
            return limit
        self._look_who_is_there(around)
        wary, yields = self._minds[rows], self._yields[rows]
        settled = np.append(on_time, False)[around.mover]  # the last one is of those who are no mover
        wary = wary & ~(on_time[rows, None] & settled)
        lookers = self._lookers(rows, going, here)
        way = free_way(lookers, wary, yields, around, tables)
        loops = self._loops(rows, way, going, around)
        if loops.any():  # those go on as if nobody of theirs were there
            wary = wary & ~(loops[:, None] & (around.mover >= 0))
            way = free_way(lookers, wary, yields, around, tables)
        limit[rows] = way.speed
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

    def _loops(self, rows: Int, way: Way, going: Going, around: Around) -> Bool:
        """(R,) which lookers stand first in a ring of movers that all wait for the next one of it."""
        found = np.zeros(len(rows), dtype=np.bool_)
        waits = {
            int(row): int(around.mover[other])
            for row, other, speed in zip(rows, way.blocker, way.speed, strict=True)
            if other >= 0 and speed < 0.1 and going.speed[row] < 0.1 and around.mover[other] >= 0
        }
        heading = {int(m): float(around.yaw[i]) for i, m in enumerate(around.mover) if m >= 0} if waits else {}
        for i, row in enumerate(rows.tolist()):
            ring = _ring(row, waits)
            if ring and row == min(ring) and np.cos(heading[row] - heading[waits[row]]) > HEAD_ON:
                found[i] = True
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
