"""Speed limits of the moving scripted actors that avoid collisions; cycles of waiting actors are broken."""

from collections.abc import Mapping, Sequence

import numpy as np

from mdrive_sumo.actors.actor_surroundings import NO_MOVER, STATIC, list_surroundings
from mdrive_sumo.actors.look_ahead import FreeSpeeds, compute_free_speeds
from mdrive_sumo.actors.movers import LOG_TIME_TOLERANCE_S
from mdrive_sumo.actors.path_tables import Rows
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int
from mdrive_sumo.core.state import DT, Actors, EgoState

WAITING_SPEED = 0.1
"""An actor that is blocked and no faster than this [m/s] counts as waiting for its blocker."""
HEAD_ON_COS = -0.95
"""Two vehicles whose headings have a lower cosine face each other, and neither proceeds; a pedestrian walks around."""


@twin
def compute_speed_limits(
    movers: Rows, knots: Rows, tick: int, egos: Sequence[EgoState], actors: Actors, index_by_id: Mapping[str, int], /
) -> Float:
    """Return the (M,) greatest speeds [m/s] of the movers; infinite where the path is free.

    egos, actors: the CAVs and all others of the frame of that tick. index_by_id: index of each moving scripted actor,
    `STATIC` of the others. Replays at the pose of their log ignore each other, because the log is consistent.
    """
    limit = np.full(len(movers), np.inf)
    has_arrived = (movers["s"] >= movers["path_length"]) & (movers["is_timed"] == 0)
    rows = np.flatnonzero((movers["avoids_collisions"] != 0) & (movers["is_present"] != 0) & ~has_arrived)
    if not len(rows):
        return limit
    surroundings = list_surroundings(egos, actors, index_by_id)
    considers = _find_considered(movers, rows, tick * DT, surroundings)
    free = compute_free_speeds(movers, knots, rows, considers, surroundings)
    limit[rows] = free.speed
    breakers = _find_deadlock_breakers(movers, rows, free, surroundings)
    # They proceed as if there were no other movers.
    considers = considers[breakers] & (surroundings["index"] < 0)
    limit[rows[breakers]] = compute_free_speeds(movers, knots, rows[breakers], considers, surroundings).speed
    return limit


def _find_considered(movers: Rows, rows: Int, now_s: float, surroundings: Rows) -> Bool:
    """Return an (R, O) mask: which surroundings each mover avoids."""
    is_timed = movers["is_timed"] != 0
    is_on_log = is_timed & (np.abs(now_s - movers["progress"]) < LOG_TIME_TOLERANCE_S)
    index = surroundings["index"]
    both_on_log = is_on_log[rows, None] & np.append(is_on_log, (False, False))[index]  # the last two: no mover
    both_on_foot = (movers["is_pedestrian"][rows, None] != 0) & surroundings["is_pedestrian"]  # they walk around
    in_log = is_timed[rows, None] & (index == STATIC)  # the logged vehicle passed the static object
    return (index != rows[:, None]) & ~both_on_foot & ~in_log & ~both_on_log


def _find_deadlock_breakers(movers: Rows, rows: Int, free: FreeSpeeds, surroundings: Rows) -> Bool:
    """Return an (R,) mask of the movers that proceed in a cycle of waiting ones: a pedestrian first, else by id."""
    blocked_by = np.append(surroundings["index"], NO_MOVER)[free.blocker]  # row -1: nothing
    is_waiting = (blocked_by >= 0) & (free.speed < WAITING_SPEED) & (movers["speed"][rows] < WAITING_SPEED)
    waits = dict(zip(rows[is_waiting].tolist(), blocked_by[is_waiting].tolist(), strict=True))
    yaw, is_pedestrian = movers["yaw"], (movers["is_pedestrian"] != 0).tolist()
    is_breaker = np.zeros(len(rows), dtype=np.bool_)
    for i in np.flatnonzero(is_waiting).tolist():
        row = int(rows[i])
        ring = _find_wait_cycle(row, waits)
        if ring and row == min(ring, key=lambda mover: (not is_pedestrian[mover], mover)):
            is_breaker[i] = is_pedestrian[row] or portable.cos(float(yaw[row] - yaw[waits[row]])) > HEAD_ON_COS
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
