"""How members of a group move if they do what was agreed: their actions, each behind those that come before it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.negotiation.conflict_graph import CONFLICT
from mdrive_sumo.negotiation.intention import (
    ACCELERATION_RANGES,
    build_line,
    convert_to_acceleration,
    predict_trajectory,
)
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.v2x.messages import Intention

ACCELERATIONS = tuple(range(0, -11, -1))
"""[m/s2] Of a member that passes behind others: the first that keeps it clear of them. The last is that of STOP."""
MAX_AGREED_BRAKING = 4.0
"""[m/s2] A member refuses to brake harder: from here on braking counts as STOP (`IntentionParameters.stop_below`)."""


@dataclass(frozen=True, slots=True)
class AgreedMotion:
    """What a member does if it keeps to an agreement."""

    points: Float
    """(`POINTS`, 2) [m]."""
    acceleration: float
    """[m/s2]"""
    is_behind: bool = True
    """Whether it passes behind all that come before it."""


def predict_agreement(
    members: Sequence[NegotiationMember], actions: Mapping[str, Intention], order: Sequence[str] = ()
) -> dict[str, AgreedMotion]:
    """Return the motion of each member with its action, in the order of passing if there is one, else of `members`.

    With an order a member slows down as far as it must to pass behind those before it, as the planner does; SLOWER is
    then the mildest braking that deserves the name, while without an order it is not known what it is for.
    """
    by_id = {member.id: member for member in members}
    motions: dict[str, AgreedMotion] = {}
    for name in order or by_id:
        member, action = by_id[name], actions[name]
        acceleration = _find_acceleration(member, action, members, is_ordered=bool(order))
        before = [motion.points for motion in motions.values()] if order else []
        motions[name] = find_motion_behind(member, before, acceleration)
    return motions


def can_carry_out(
    me: str, members: Sequence[NegotiationMember], actions: Mapping[str, Intention], order: Sequence[str]
) -> bool:
    """Return whether a member can pass behind those before it in an order without braking hard."""
    before = order[: order.index(me)]
    motions = predict_agreement([member for member in members if member.id in before], actions, before)
    mine = next(member for member in members if member.id == me)
    motion = find_motion_behind(mine, [motion.points for motion in motions.values()], 0.0)
    return motion.is_behind and motion.acceleration >= -MAX_AGREED_BRAKING


def find_motion_behind(member: NegotiationMember, before: Sequence[Float], acceleration: float) -> AgreedMotion:
    """Return the motion of a member with that acceleration [m/s2], or the first lower one that keeps it behind others.

    before: trajectories (`POINTS`, 2) [m] of those that pass before it. It is behind them if it is never too close to a
    place where one of them is at that time or later.
    """
    line = build_line(member.x, member.y, member.yaw, member.desired)
    trials = (acceleration, *(float(lower) for lower in ACCELERATIONS if lower < acceleration))
    for trial in trials:
        points = predict_trajectory(line, member.speed, trial)
        if all(_passes_behind(points, other) for other in before):
            return AgreedMotion(points, trial)
    return AgreedMotion(predict_trajectory(line, member.speed, trials[-1]), trials[-1], is_behind=False)


def _passes_behind(points: Float, other: Float) -> bool:
    dx, dy = points[:, None, 0] - other[None, :, 0], points[:, None, 1] - other[None, :, 1]
    later = np.triu(np.ones(dx.shape, dtype=np.bool_))
    return float(portable.hypot(dx, dy).min(where=later, initial=np.inf)) >= CONFLICT.min_distance_m


def _find_acceleration(
    member: NegotiationMember, action: Intention, members: Sequence[NegotiationMember], is_ordered: bool
) -> float:
    """Return the acceleration [m/s2] of an action, before the member waits for others."""
    if is_ordered and action == Intention.SLOWER:
        return ACCELERATION_RANGES[action][1]
    gaps = [float(portable.hypot(m.x - member.x, m.y - member.y)) for m in members if m.id != member.id]
    return convert_to_acceleration(action, min(gaps, default=np.inf), len(gaps))
