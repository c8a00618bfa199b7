"""Intersect the swept boxes of actors on their paths with the boxes of everything else.

An actor looks along its path over its stopping distance and a margin. An obstacle there limits its speed to one from
which comfortable braking ends before the obstacle, or at the obstacle's speed along the path.
"""

from typing import NamedTuple

import numpy as np

from mdrive_sumo.actors.actor_surroundings import ActorSurroundings
from mdrive_sumo.actors.kinematic_limits import compute_safe_speed
from mdrive_sumo.actors.path_tables import PathPoints, PathTables
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap

SAMPLES = 16
"""Number of boxes along the path ahead; they are lengthened where they would leave gaps."""


class LookAhead(NamedTuple):
    """The R actors that look ahead; arrays are (R,)."""

    movers: Int
    """Their indices among the moving scripted actors."""
    x: Float
    y: Float
    s: Float
    """Arc length of the box centre [m]."""
    reach: Float
    """How far ahead of their box they look [m]."""
    half_length: Float
    half_width: Float
    """Half width [m] of the swept area."""
    gap: Float
    comfort_brake: Float
    prediction_s: Float


class ConflictPairs(NamedTuple):
    """P pairs of an actor and something close to its path; arrays are (P,)."""

    looker: Int
    """Row of `LookAhead`."""
    other: Int
    """Row of `ActorSurroundings`."""
    extension_m: Float
    """Length [m] by which the other's box is extended ahead of it, for its predicted motion."""


class FreeSpeeds(NamedTuple):
    """Speed limits by obstacles; arrays are (R,)."""

    speed: Float
    """Greatest speed [m/s]; infinite on a free path."""
    blocker: Int
    """Row of `ActorSurroundings` that limits the speed; -1 if none."""


def compute_free_speeds(
    look_ahead: LookAhead, considers: Bool, yields: Bool, surroundings: ActorSurroundings, tables: PathTables
) -> FreeSpeeds:
    """Return the greatest speed of each actor and what limits it.

    `considers` (R, O): which road users an actor avoids. `yields` (R, O): to which it gives way; their boxes cover
    the positions of the next `prediction_s` seconds.
    """
    count = len(look_ahead.movers)
    speed, blocker = np.full(count, np.inf), np.full(count, -1, dtype=np.int64)
    pairs = _find_near_pairs(look_ahead, considers, yields, surroundings)
    if not len(pairs.looker):
        return FreeSpeeds(speed, blocker)
    clearance, along = _compute_clearances(look_ahead, pairs, surroundings, tables)
    allowed = _compute_allowed_speeds(
        clearance, np.maximum(along, 0.0), look_ahead.gap[pairs.looker], look_ahead.comfort_brake[pairs.looker]
    )
    allowed[_find_overlaps(look_ahead, pairs, clearance, surroundings, tables)] = np.inf
    order = np.lexsort((allowed, pairs.looker))  # the first row of each looker is its minimum
    least = order[np.append(True, np.diff(pairs.looker[order]) > 0)]
    speed[pairs.looker[least]] = allowed[least]
    blocker[pairs.looker[least]] = np.where(np.isfinite(allowed[least]), pairs.other[least], -1)
    return FreeSpeeds(speed, blocker)


def _find_near_pairs(
    look_ahead: LookAhead, considers: Bool, yields: Bool, surroundings: ActorSurroundings
) -> ConflictPairs:
    extension = np.where(yields, look_ahead.prediction_s[:, None] * surroundings.speed, 0.0)
    reach = (look_ahead.reach + look_ahead.half_length + look_ahead.half_width)[:, None]
    reach = reach + (surroundings.half_length + surroundings.half_width) + extension
    x, y = look_ahead.x[:, None] - surroundings.x, look_ahead.y[:, None] - surroundings.y
    looker, other = np.nonzero(considers & (x * x + y * y < reach * reach))
    return ConflictPairs(looker, other, extension[looker, other])


def _compute_clearances(
    look_ahead: LookAhead, pairs: ConflictPairs, surroundings: ActorSurroundings, tables: PathTables
) -> tuple[Float, Float]:
    """Return (P,) the free path [m] between the boxes (infinite: not on the path), and the other's speed along it."""
    unique_lookers, pair = np.unique(pairs.looker, return_inverse=True)
    spread = look_ahead.reach[unique_lookers, None] * np.linspace(0.0, 1.0, SAMPLES)
    path = tables.sample_ahead(look_ahead.movers[unique_lookers], look_ahead.s[unique_lookers, None] + spread)
    cos, sin = (part[pair] for part in portable.cos_sin(path.yaw))
    cos_o, sin_o = (part[:, None] for part in portable.cos_sin(surroundings.yaw[pairs.other]))
    half = pairs.extension_m[:, None] / 2
    x = surroundings.x[pairs.other, None] + cos_o * half - path.x[pair]
    y = surroundings.y[pairs.other, None] + sin_o * half - path.y[pair]
    length, width = surroundings.half_length[pairs.other, None] + half, surroundings.half_width[pairs.other, None]
    turned = np.abs(cos * cos_o + sin * sin_o), np.abs(cos * sin_o - sin * cos_o)
    box = look_ahead.half_length[pairs.looker, None], look_ahead.half_width[pairs.looker, None]
    swept = np.maximum(box[0], look_ahead.reach[pairs.looker, None] / (SAMPLES - 1) / 2)
    along = x * cos + y * sin
    extent = turned[0] * length + turned[1] * width
    # Separating axes: along and across the path, along and across the other box.
    hit = np.abs(along) < swept + extent
    hit &= np.abs(y * cos - x * sin) < box[1] + turned[1] * length + turned[0] * width
    hit &= np.abs(x * cos_o + y * sin_o) < length + turned[0] * swept + turned[1] * box[1]
    hit &= np.abs(y * cos_o - x * sin_o) < width + turned[1] * swept + turned[0] * box[1]
    centre = spread[pair] + along
    clearance = np.where(
        hit & (centre > 0.0), centre - box[0] - extent, np.inf
    )  # what is behind does not block the path
    nearest = clearance.argmin(1)
    rows = np.arange(len(nearest))
    heading = cos[rows, nearest] * cos_o[:, 0] + sin[rows, nearest] * sin_o[:, 0]
    return clearance[rows, nearest], heading * surroundings.speed[pairs.other]


def _compute_allowed_speeds(clearance: Float, speed: Float, gap: Float, comfort_brake: Float) -> Float:
    """Return the speed [m/s] from which comfortable braking ends `gap` [m] behind something that moves at `speed`."""
    slack = clearance - gap
    return np.where(
        slack > 0.0, compute_safe_speed(slack, speed, comfort_brake), speed * np.clip(clearance / gap, 0.0, 1.0)
    )


def _find_overlaps(
    look_ahead: LookAhead, pairs: ConflictPairs, clearance: Float, surroundings: ActorSurroundings, tables: PathTables
) -> Bool:
    """Return a (P,) mask of pairs that overlap already: stopping does not resolve that. CAVs are excepted."""
    stuck = (clearance < 0.0) & (pairs.other >= surroundings.cav_count)
    if not stuck.any():
        return stuck
    looker, other = pairs.looker[stuck], pairs.other[stuck]
    here: PathPoints = tables.sample_ahead(look_ahead.movers[looker], look_ahead.s[looker, None])
    own = boxes_corners(
        here.x[:, 0],
        here.y[:, 0],
        here.yaw[:, 0],
        2 * look_ahead.half_length[looker],
        2 * look_ahead.half_width[looker],
    )
    other = boxes_corners(
        surroundings.x[other],
        surroundings.y[other],
        surroundings.yaw[other],
        2 * surroundings.half_length[other],
        2 * surroundings.half_width[other],
    )
    stuck[stuck] = boxes_overlap(own, other)
    return stuck
