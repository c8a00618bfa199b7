"""What comes of the actions agreed upon: re-predicted, scored, and criticised (protocol 10.4)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.negotiation.conflict_graph import build_trajectory_graph, compute_safety
from mdrive_sumo.negotiation.intention import (
    INTERVAL_S,
    TOP_SPEED,
    build_way,
    convert_to_acceleration,
    predict_trajectory,
    replace_slow_keep,
)
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.v2x.messages import Intention

SAFE_ENOUGH = 0.7
"""3.42 m"""
FAST_ENOUGH = 0.4
"""3.2 m/s"""


@dataclass(frozen=True, slots=True)
class Critique:
    """How good it is if everybody does what was agreed."""

    safety: float
    """Of the least safe pair, in (0, 1)."""
    efficiency: float
    """Mean predicted speed of all by 8 m/s, at most 1."""
    feedback: str
    """What is wrong, in words; "" if nothing is."""


def avoid_slow_keeping(actions: Mapping[str, Intention], members: Sequence[NegotiationMember]) -> dict[str, Intention]:
    """The actions as they are carried out: keeping a low speed becomes going faster."""
    return {m.id: replace_slow_keep(actions[m.id], m.speed) for m in members}


def evaluate_actions(members: Sequence[NegotiationMember], actions: Mapping[str, Intention]) -> Critique:
    """Judges the actions of all members of a group."""
    predicted = {m.id: _predicted(m, actions[m.id], members) for m in members}
    graph = build_trajectory_graph(tuple(predicted), predicted)
    first, second = divmod(int(graph.distance.argmin()), len(graph.ids))
    least = compute_safety(float(graph.distance[first, second]))
    efficiency = min(1.0, float(np.mean([_speed(m, predicted[m.id]) for m in members])) / TOP_SPEED)
    if least < SAFE_ENOUGH:
        pair = f"{graph.ids[first]} and {graph.ids[second]}"
        feedback = f"{pair} would come too close: one of them should yield, the other go faster."
    elif efficiency < FAST_ENOUGH:
        feedback = "All are too slow: who is not in the way of others should go faster."
    else:
        feedback = ""
    return Critique(least, efficiency, feedback)


def _predicted(member: NegotiationMember, action: Intention, members: Sequence[NegotiationMember]) -> Float:
    """The trajectory of a member that does so, on the way that it desires."""
    gaps = [float(np.hypot(m.x - member.x, m.y - member.y)) for m in members if m.id != member.id]
    way = build_way(member.x, member.y, member.yaw, member.desired)
    return predict_trajectory(way, member.speed, convert_to_acceleration(action, min(gaps), len(gaps)))


def _speed(member: NegotiationMember, points: Float) -> float:
    """Mean speed [m/s] of a trajectory."""
    steps = np.diff(np.vstack(((member.x, member.y), points)), axis=0)
    return float(np.hypot(steps[:, 0], steps[:, 1]).mean()) / INTERVAL_S
