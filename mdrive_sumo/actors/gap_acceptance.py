"""Gap acceptance of people who cross a road: whether every vehicle that approaches could stop comfortably."""

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Bool, Float
from mdrive_sumo.core.state import Frame, Kind
from mdrive_sumo.scenario.scripted_actor import Actor, PathMotion

COMFORTABLE_DECEL = 3.0
"""[m/s2] Braking that drivers find comfortable (AASHTO's stopping sight distance assumes 3.4)."""
REACTION_S = 1.0
"""[s] Until a driver brakes: SUMO's drivers decide every 0.5 s and keep 1 s."""
MARGIN_M = 3.0
"""[m] Free distance to where a vehicle would come to a stand: SUMO's least gap of 2.5 m and half a person."""
NEAR_M = 12.0
"""[m] Nearer than this a moving vehicle may still turn onto the path: two widths of a junction's lane and a bumper."""
STANDING_MPS = 0.3
"""[m/s] A slower vehicle stands."""
AHEAD_COS, BESIDE_COS = 0.7, -0.2
"""Cosine of the angle between a vehicle's heading and the way to the path up to which it approaches: 45 degrees from
afar, a little behind its side when it is near, since its tail follows."""
CAV_M = 4.9
"""[m] Length of a CAV."""


def is_gap(actor: Actor, frame: Frame) -> bool:
    """Return whether no moving vehicle or cyclist hinders the actor from crossing along its path's first stretch."""
    assert isinstance(actor.motion, PathMotion)
    x, y, yaw, speed, length = _collect_moving(frame)
    if not len(x):
        return True
    (x0, y0), (x1, y1) = actor.motion.points[:2]
    dx, dy = x1 - x0, y1 - y0
    share = np.clip(((x - x0) * dx + (y - y0) * dy) / max(dx * dx + dy * dy, 1e-9), 0.0, 1.0)
    away_x, away_y = x0 + share * dx - x, y0 + share * dy - y
    distance = portable.hypot(away_x, away_y)
    cos, sin = portable.cos_sin(yaw)
    toward = cos * away_x + sin * away_y
    stopping = speed * REACTION_S + speed * speed / (2 * COMFORTABLE_DECEL) + MARGIN_M + length / 2
    hinders: Bool = (distance < stopping) & (toward > AHEAD_COS * distance)
    hinders |= (distance < NEAR_M + length / 2) & (toward > BESIDE_COS * distance)
    return not hinders.any()


def _collect_moving(frame: Frame) -> tuple[Float, Float, Float, Float, Float]:
    """Return x, y [m], yaw [rad], speed [m/s] and length [m] of the vehicles and cyclists that move."""
    others, egos = frame.actors, tuple(frame.egos.values())
    rolls = np.isin(others.kind, (Kind.VEHICLE, Kind.CYCLIST)) & (others.speed > STANDING_MPS)
    moving = [ego for ego in egos if ego.speed > STANDING_MPS]
    own = np.array([(ego.x, ego.y, ego.yaw, ego.speed, CAV_M) for ego in moving], dtype=np.float64).reshape(-1, 5).T
    columns = (others.x, others.y, others.yaw, others.speed, others.length)
    x, y, yaw, speed, length = (
        np.concatenate((column[rolls], mine)) for column, mine in zip(columns, own, strict=True)
    )
    return x, y, yaw, speed, length
