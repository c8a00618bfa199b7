"""Conflicts between known future poses and a road user whose motion is extrapolated."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, boxes_corners, boxes_overlap
from mdrive_sumo.core.state import DT, Actors
from mdrive_sumo.sumo.logged_poses import LoggedPoses

PREDICTION_TICKS = np.arange(0, 61, 3)
"""Ticks ahead (J,) for which a road user is extrapolated: now to 3 s."""


@dataclass(frozen=True, slots=True)
class ConflictParams:
    """When the situation differs from the log: assumptions."""

    margin_m: float = 0.1
    """Boxes nearer than this are in conflict."""
    braking: float = -3.0
    """[m/s2] Plausible deceleration of a driver. A conflict counts only if neither it nor `accelerating` nor constant
    speed avoids it; otherwise every CAV that is about to brake behind a logged car would be in conflict."""
    accelerating: float = 2.0
    """[m/s2]"""
    search_margin_m: float = 20.0
    """Allowance for box dimensions, acceleration and margin in the search of candidates."""


PARAMS = ConflictParams()


@dataclass(frozen=True, slots=True)
class MovingBox:
    """The box of a road user that is on no log, and its speed along its yaw."""

    x: float
    y: float
    yaw: float
    speed: float
    length: float
    width: float
    off_log: bool = False
    """Whether it left its log: then a conflict at constant speed suffices."""


def build_moving_box(actors: Actors, i: int, off_log: bool = False) -> MovingBox:
    """Return the box of actor `i`."""
    columns = (actors.x, actors.y, actors.yaw, actors.speed, actors.length, actors.width)
    x, y, yaw, speed, length, width = (float(column[i]) for column in columns)
    return MovingBox(x, y, yaw, speed, length, width, off_log)


@twin
def find_conflicts(poses: LoggedPoses, tick: int, is_candidate: Bool, mover: MovingBox, /) -> Bool:
    """Return a (V,) mask of the candidate vehicles that are in conflict with the mover now, or inevitably will be."""
    now = poses.poses[:, tick]
    reach = PARAMS.search_margin_m + (mover.speed + np.abs(now[:, 3])) * PREDICTION_TICKS[-1] * DT
    near = np.flatnonzero(is_candidate & (portable.hypot(now[:, 0] - mover.x, now[:, 1] - mover.y) < reach))
    in_conflict = np.zeros_like(is_candidate)
    if len(near):
        ticks = np.minimum(tick + PREDICTION_TICKS, poses.present.shape[1] - 1)
        present = poses.present[near][:, ticks] & (tick + PREDICTION_TICKS == ticks)
        x, y, yaw, _ = np.moveaxis(poses.poses[near][:, ticks], -1, 0)
        boxes = boxes_corners(x, y, yaw, *(poses.dimensions[near].T[:, :, None] + 2 * PARAMS.margin_m))
        as_now, *others = (
            present & boxes_overlap(boxes, _extrapolate_boxes(mover, a))
            for a in (0.0, PARAMS.braking, PARAMS.accelerating)
        )
        inevitable = np.all([hit.any(axis=1) for hit in (as_now, *others)], axis=0)
        in_conflict[near] = as_now[:, 0] | (as_now.any(axis=1) if mover.off_log else inevitable)
    return in_conflict


def _extrapolate_boxes(mover: MovingBox, acceleration: float) -> Float:
    """Return the corners (J, 4, 2) of the mover, straight on with a constant acceleration [m/s2] until it stands."""
    time = PREDICTION_TICKS * DT
    if acceleration < 0:
        time = np.minimum(time, max(mover.speed, 0.0) / -acceleration)
    ahead = mover.speed * time + acceleration * (time * time) / 2
    cos, sin = portable.cos_sin(mover.yaw)
    x, y = mover.x + cos * ahead, mover.y + sin * ahead
    return boxes_corners(x, y, np.array(mover.yaw), np.array(mover.length), np.array(mover.width))
