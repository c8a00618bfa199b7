"""Whether somebody's known way leads into somebody else, who goes on as people do."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Bool, Float, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import DT, Actors
from mdrive_sumo.sumo.logged_poses import Logs

LOOK_TICKS = np.arange(0, 61, 3)
"""Moments (J,) for which a mover is carried on: now to 3 s."""
MARGIN_M = 0.1
"""Boxes nearer than this meet."""
BRAKING, SPEEDING = -3.0, 2.0
"""Accelerations [m/s2] that a driver may well choose. The situation is another one than in the log if neither they nor
going on as now lead around a meeting; else every CAV that is about to brake behind a logged car would change it."""
REACH_M = 20.0
"""Sizes of boxes, acceleration and margin, for the search of those that could meet."""


@dataclass(frozen=True, slots=True)
class Mover:
    """Something that is not on a log: box and speed along its yaw."""

    x: float
    y: float
    yaw: float
    speed: float
    length: float
    width: float
    off_log: bool = False
    """Whether it has a log and left it: then it is enough that going on as now leads to a meeting."""


def mover_of(actors: Actors, i: int, off_log: bool = False) -> Mover:
    """One of the actors."""
    columns = (actors.x, actors.y, actors.yaw, actors.speed, actors.length, actors.width)
    x, y, yaw, speed, length, width = (float(column[i]) for column in columns)
    return Mover(x, y, yaw, speed, length, width, off_log)


def meets(logs: Logs, tick: int, there: Bool, mover: Mover) -> Bool:
    """Which of the vehicles that are `there` (V,) meet the mover now, or will whatever it does (V,)."""
    now = logs.poses[:, tick]
    reach = REACH_M + (mover.speed + np.abs(now[:, 3])) * LOOK_TICKS[-1] * DT
    near = np.flatnonzero(there & (np.hypot(now[:, 0] - mover.x, now[:, 1] - mover.y) < reach))
    met = np.zeros_like(there)
    if len(near):
        ticks = np.minimum(tick + LOOK_TICKS, logs.present.shape[1] - 1)
        present = logs.present[near][:, ticks] & (tick + LOOK_TICKS == ticks)
        x, y, yaw, _ = np.moveaxis(logs.poses[near][:, ticks], -1, 0)
        boxes = boxes_corners(x, y, yaw, *(logs.size[near].T[:, :, None] + 2 * MARGIN_M))
        as_now, *others = (present & boxes_overlap(boxes, _carried(mover, a)) for a in (0.0, BRAKING, SPEEDING))
        inevitable = np.all([hit.any(axis=1) for hit in (as_now, *others)], axis=0)
        met[near] = as_now[:, 0] | (as_now.any(axis=1) if mover.off_log else inevitable)
    return met


def _carried(mover: Mover, acceleration: float) -> Float:
    """Corners (J, 4, 2) of the mover in the look-ahead, straight on with one acceleration [m/s2] until it stands."""
    time = LOOK_TICKS * DT
    if acceleration < 0:
        time = np.minimum(time, max(mover.speed, 0.0) / -acceleration)
    ahead = mover.speed * time + acceleration * time**2 / 2
    x, y = mover.x + np.cos(mover.yaw) * ahead, mover.y + np.sin(mover.yaw) * ahead
    return boxes_corners(x, y, np.array(mover.yaw), np.array(mover.length), np.array(mover.width))
