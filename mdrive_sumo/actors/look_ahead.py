"""What is in the way: the swept boxes of courses against everybody who may be on them.

A road user looks along its own course as far as it needs to stop, and a bit. What it would run into there limits its
speed to one from which it can brake comfortably to a stop before it (or to the speed of what drives ahead).
"""

from typing import NamedTuple

import numpy as np

from mdrive_sumo.actors.actor_surroundings import Around
from mdrive_sumo.actors.kinematic_limits import safe_speed
from mdrive_sumo.actors.path_tables import Places, Tables
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, boxes_overlap

SAMPLES = 16
"""Boxes along the way ahead; they are made longer where they would leave gaps."""


class Lookers(NamedTuple):
    """Those who look ahead, (R,) each."""

    rows: Int
    """Which movers they are."""
    x: Float
    y: Float
    s: Float
    """Arc length of the box centre [m]."""
    reach: Float
    """How far ahead of their box they look [m]."""
    half_length: Float
    half_width: Float
    """Of what they sweep [m]."""
    gap: Float
    brake: Float
    foresight: Float


class Pairs(NamedTuple):
    """Who may be in whose way, (P,) each."""

    who: Int
    """Index of the looker."""
    whom: Int
    """Row of `Around`."""
    onward: Float
    """How much longer the other's box is taken to be, ahead of it [m]."""


class Way(NamedTuple):
    """How free the ways are, (R,) each."""

    speed: Float
    """At most this fast [m/s]; infinite if nothing is in the way."""
    blocker: Int
    """Row of `Around` that limits it; -1: nobody."""


def free_way(lookers: Lookers, wary: Bool, yields: Bool, around: Around, tables: Tables) -> Way:
    """How fast each looker may go.

    `wary` (R, O): whom each minds. `yields` (R, O): to whom it gives way, so that it sees them everywhere they will be
    in the next `foresight` seconds.
    """
    count = len(lookers.rows)
    speed, blocker = np.full(count, np.inf), np.full(count, -1, dtype=np.int64)
    pairs = _near(lookers, wary, yields, around)
    if not len(pairs.who):
        return Way(speed, blocker)
    room, along = _room(lookers, pairs, around, tables)
    allowed = _allowed(room, np.maximum(along, 0.0), lookers.gap[pairs.who], lookers.brake[pairs.who])
    allowed[_stuck_in(lookers, pairs, room, around, tables)] = np.inf
    order = np.lexsort((allowed, pairs.who))  # the first one of each looker is its least
    least = order[np.append(True, np.diff(pairs.who[order]) > 0)]
    speed[pairs.who[least]] = allowed[least]
    blocker[pairs.who[least]] = np.where(np.isfinite(allowed[least]), pairs.whom[least], -1)
    return Way(speed, blocker)


def _near(lookers: Lookers, wary: Bool, yields: Bool, around: Around) -> Pairs:
    onward = np.where(yields, lookers.foresight[:, None] * around.speed, 0.0)
    reach = (lookers.reach + lookers.half_length + lookers.half_width)[:, None]
    reach = reach + (around.half_length + around.half_width) + onward
    x, y = lookers.x[:, None] - around.x, lookers.y[:, None] - around.y
    who, whom = np.nonzero(wary & (x * x + y * y < reach * reach))
    return Pairs(who, whom, onward[who, whom])


def _room(lookers: Lookers, pairs: Pairs, around: Around, tables: Tables) -> tuple[Float, Float]:
    """Free way [m] from each looker's box to the other's (infinite: not in the way), and the other's speed along."""
    some, pair = np.unique(pairs.who, return_inverse=True)
    spread = lookers.reach[some, None] * np.linspace(0.0, 1.0, SAMPLES)
    way = tables.ahead(lookers.rows[some], lookers.s[some, None] + spread)
    cos, sin = np.cos(way.yaw)[pair], np.sin(way.yaw)[pair]
    cos_o, sin_o = np.cos(around.yaw[pairs.whom])[:, None], np.sin(around.yaw[pairs.whom])[:, None]
    half = pairs.onward[:, None] / 2
    x = around.x[pairs.whom, None] + cos_o * half - way.x[pair]
    y = around.y[pairs.whom, None] + sin_o * half - way.y[pair]
    length, width = around.half_length[pairs.whom, None] + half, around.half_width[pairs.whom, None]
    turned = np.abs(cos * cos_o + sin * sin_o), np.abs(cos * sin_o - sin * cos_o)
    box = lookers.half_length[pairs.who, None], lookers.half_width[pairs.who, None]
    swept = np.maximum(box[0], lookers.reach[pairs.who, None] / (SAMPLES - 1) / 2)
    along = x * cos + y * sin
    extent = turned[0] * length + turned[1] * width
    # Separating axes: along and across the way, along and across the other.
    hit = np.abs(along) < swept + extent
    hit &= np.abs(y * cos - x * sin) < box[1] + turned[1] * length + turned[0] * width
    hit &= np.abs(x * cos_o + y * sin_o) < length + turned[0] * swept + turned[1] * box[1]
    hit &= np.abs(y * cos_o - x * sin_o) < width + turned[1] * swept + turned[0] * box[1]
    centre = spread[pair] + along
    room = np.where(hit & (centre > 0.0), centre - box[0] - extent, np.inf)  # what is behind is not in the way
    nearest = room.argmin(1)
    rows = np.arange(len(nearest))
    heading = cos[rows, nearest] * cos_o[:, 0] + sin[rows, nearest] * sin_o[:, 0]
    return room[rows, nearest], heading * around.speed[pairs.whom]


def _allowed(room: Float, speed: Float, gap: Float, brake: Float) -> Float:
    """Speed [m/s] from which it can brake so that it ends `gap` behind something that goes at `speed`."""
    slack = room - gap
    return np.where(slack > 0.0, safe_speed(slack, speed, brake), speed * np.clip(room / gap, 0.0, 1.0))


def _stuck_in(lookers: Lookers, pairs: Pairs, room: Float, around: Around, tables: Tables) -> Bool:
    """Which of the pairs overlap now: stopping does not mend that. A CAV is waited for all the same."""
    stuck = (room < 0.0) & (pairs.whom >= around.cavs)
    if not stuck.any():
        return stuck
    who, whom = pairs.who[stuck], pairs.whom[stuck]
    here: Places = tables.ahead(lookers.rows[who], lookers.s[who, None])
    own = boxes_corners(
        here.x[:, 0], here.y[:, 0], here.yaw[:, 0], 2 * lookers.half_length[who], 2 * lookers.half_width[who]
    )
    other = boxes_corners(
        around.x[whom], around.y[whom], around.yaw[whom], 2 * around.half_length[whom], 2 * around.half_width[whom]
    )
    stuck[stuck] = boxes_overlap(own, other)
    return stuck
