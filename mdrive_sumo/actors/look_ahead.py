"""Intersect the swept boxes of actors on their paths with the boxes of everything else.

An actor looks along its path over its stopping distance and a margin. An obstacle there limits its speed to one from
which comfortable braking ends before the obstacle, or at the obstacle's speed along the path.
"""

from typing import NamedTuple

import numpy as np

from mdrive_sumo.actors.kinematic_limits import compute_safe_speed
from mdrive_sumo.actors.path_tables import Rows, sample_ahead
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap

SAMPLES = 16
"""Number of boxes along the path ahead; they are lengthened where they would leave gaps."""


class ConflictPairs(NamedTuple):
    """P pairs of an actor and something close to its path."""

    looker: Int
    """(P,) row of each looker, ascending."""
    mover: Rows
    """(P,) the looker itself, ..."""
    half_width: Float
    """... half the width [m] of its swept area, ..."""
    reach: Float
    """... and how far ahead of its box it looks [m]."""
    surrounding: Int
    """(P,) row of each obstacle."""
    other: Rows
    """(P,) the obstacle."""
    extension_m: Float
    """(P,) length by which the other's box is extended ahead of it, for its predicted motion."""


class FreeSpeeds(NamedTuple):
    """Speed limits by obstacles; arrays are (R,)."""

    speed: Float
    """Greatest speed [m/s]; infinite on a free path."""
    blocker: Int
    """Row of the surroundings that limits the speed; -1 if none."""


def compute_free_speeds(movers: Rows, knots: Rows, rows: Int, considers: Bool, surroundings: Rows) -> FreeSpeeds:
    """Return the greatest speeds of the movers `rows` (R,), and what limits them.

    `considers` (R, O): which surroundings each avoids.
    """
    speed, blocker = np.full(len(rows), np.inf), np.full(len(rows), -1, dtype=np.int64)
    pairs = _find_near_pairs(movers, rows, considers, surroundings)
    if not len(pairs.looker):
        return FreeSpeeds(speed, blocker)
    clearance, along = _compute_clearances(movers, knots, rows, pairs)
    allowed = _compute_allowed_speeds(clearance, np.maximum(along, 0.0), pairs.mover)
    allowed[_find_overlaps(movers, knots, rows, pairs, clearance)] = np.inf
    order = np.lexsort((allowed, pairs.looker))  # the first row of each looker is its minimum
    least = order[np.append(True, np.diff(pairs.looker[order]) > 0)]
    speed[pairs.looker[least]] = allowed[least]
    blocker[pairs.looker[least]] = np.where(np.isfinite(allowed[least]), pairs.surrounding[least], -1)
    return FreeSpeeds(speed, blocker)


def _find_near_pairs(movers: Rows, rows: Int, considers: Bool, surroundings: Rows) -> ConflictPairs:
    mover = movers[rows]
    index, on_foot = surroundings["index"], surroundings["is_pedestrian"]
    # It gives way to pedestrians and to actors before it: their boxes cover the positions of the next seconds.
    yields = (mover["prediction_s"] > 0.0)[:, None] & (index >= 0) & (on_foot | (index < rows[:, None]))
    extension = np.where(yields, mover["prediction_s"][:, None] * surroundings["speed"], 0.0)
    speed, half_width = mover["speed"], mover["half_width"] + mover["clearance"]
    reach = speed * speed / (2.0 * mover["comfort_brake"]) + mover["gap"] + mover["look_margin"]
    far = (reach + mover["half_length"] + half_width)[:, None]
    far = far + (surroundings["half_length"] + surroundings["half_width"]) + extension
    x, y = mover["x"][:, None] - surroundings["x"], mover["y"][:, None] - surroundings["y"]
    looker, other = np.nonzero(considers & (x * x + y * y < far * far))
    return ConflictPairs(
        looker, mover[looker], half_width[looker], reach[looker], other, surroundings[other], extension[looker, other]
    )


def _compute_clearances(movers: Rows, knots: Rows, rows: Int, pairs: ConflictPairs) -> tuple[Float, Float]:
    """Return (P,) the free path [m] between the boxes (infinite: not on the path), and the other's speed along it."""
    mover, other = pairs.mover[:, None], pairs.other[:, None]
    spread = pairs.reach[:, None] * np.linspace(0.0, 1.0, SAMPLES)
    path = sample_ahead(movers, knots, rows[pairs.looker], mover["s"] + spread)
    cos, sin = portable.cos_sin(path.yaw)
    cos_o, sin_o = portable.cos_sin(other["yaw"])
    half = pairs.extension_m[:, None] / 2
    x, y = other["x"] + cos_o * half - path.x, other["y"] + sin_o * half - path.y
    length, width = other["half_length"] + half, other["half_width"]
    turned = np.abs(cos * cos_o + sin * sin_o), np.abs(cos * sin_o - sin * cos_o)
    half_width = pairs.half_width[:, None]
    swept = np.maximum(mover["half_length"], pairs.reach[:, None] / (SAMPLES - 1) / 2)
    along = x * cos + y * sin
    extent = turned[0] * length + turned[1] * width
    # Separating axes: along and across the path, along and across the other box.
    hit = np.abs(along) < swept + extent
    hit &= np.abs(y * cos - x * sin) < half_width + turned[1] * length + turned[0] * width
    hit &= np.abs(x * cos_o + y * sin_o) < length + turned[0] * swept + turned[1] * half_width
    hit &= np.abs(y * cos_o - x * sin_o) < width + turned[1] * swept + turned[0] * half_width
    centre = spread + along
    is_ahead = hit & (centre > 0.0)  # what is behind does not block the path
    clearance = np.where(is_ahead, centre - mover["half_length"] - extent, np.inf)
    nearest = np.arange(len(clearance)), clearance.argmin(1)
    heading = cos[nearest] * cos_o[:, 0] + sin[nearest] * sin_o[:, 0]
    return clearance[nearest], heading * pairs.other["speed"]


def _compute_allowed_speeds(clearance: Float, speed: Float, mover: Rows) -> Float:
    """Return the speed [m/s] from which comfortable braking ends a gap behind something that moves at `speed`."""
    slack = clearance - mover["gap"]
    closing = speed * np.clip(clearance / mover["gap"], 0.0, 1.0)
    return np.where(slack > 0.0, compute_safe_speed(slack, speed, mover["comfort_brake"]), closing)


def _find_overlaps(movers: Rows, knots: Rows, rows: Int, pairs: ConflictPairs, clearance: Float) -> Bool:
    """Return a (P,) mask of pairs that overlap already: stopping does not resolve that. CAVs are excepted."""
    is_stuck = (clearance < 0.0) & ~pairs.other["is_cav"]
    mover, other = pairs.mover[is_stuck], pairs.other[is_stuck]
    here = sample_ahead(movers, knots, rows[pairs.looker[is_stuck]], mover["s"][:, None])
    length, width = 2 * mover["half_length"], 2 * pairs.half_width[is_stuck]
    own = boxes_corners(here.x[:, 0], here.y[:, 0], here.yaw[:, 0], length, width)
    length, width = 2 * other["half_length"], 2 * other["half_width"]
    is_stuck[is_stuck] = boxes_overlap(own, boxes_corners(other["x"], other["y"], other["yaw"], length, width))
    return is_stuck
