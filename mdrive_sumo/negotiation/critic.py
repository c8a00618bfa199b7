"""The critic: predicts agreed actions, scores their safety and efficiency, and criticises them (protocol 10.4)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.negotiation.conflict_graph import build_trajectory_graph, compute_safety
from mdrive_sumo.negotiation.intention import INTENTION, INTERVAL_S, replace_slow_keep
from mdrive_sumo.negotiation.negotiator import NegotiationMember
from mdrive_sumo.negotiation.order_prediction import predict_agreement
from mdrive_sumo.v2x.messages import Intention


@dataclass(frozen=True, slots=True)
class CriticParameters:
    """Thresholds below which the critic objects. Source: protocol 10.4."""

    min_safety: float = 0.7
    """A distance of 3.42 m."""
    min_efficiency: float = 0.4
    """A mean speed of 3.2 m/s."""


CRITIC_PARAMETERS = CriticParameters()


@dataclass(frozen=True, slots=True)
class Critique:
    """The quality of the agreed actions."""

    safety: float
    """Of the least safe pair, in (0, 1)."""
    efficiency: float
    """Mean predicted speed of all members divided by 8 m/s, at most 1."""
    feedback: str
    """The objection in words; "" if there is none."""


def avoid_slow_keeping(actions: Mapping[str, Intention], members: Sequence[NegotiationMember]) -> dict[str, Intention]:
    """Return the actions as they are carried out: KEEP at a low speed becomes FASTER."""
    return {member.id: replace_slow_keep(actions[member.id], member.speed) for member in members}


def evaluate_actions(
    members: Sequence[NegotiationMember],
    actions: Mapping[str, Intention],
    order: Sequence[str] = (),
    parameters: CriticParameters = CRITIC_PARAMETERS,
) -> Critique:
    """Return the critique of the actions of all members of a group, who pass in that order if there is one."""
    motions = predict_agreement(members, actions, order)
    predicted = {member.id: motions[member.id].points for member in members}
    graph = build_trajectory_graph(tuple(predicted), predicted)
    first, second = divmod(int(graph.distance.argmin()), len(graph.ids))
    safety = compute_safety(float(graph.distance[first, second]))
    speeds = [_compute_mean_speed(member, predicted[member.id]) for member in members]
    efficiency = min(1.0, float(np.mean(speeds)) / INTENTION.top_speed)
    if safety < parameters.min_safety:
        pair = f"{graph.ids[first]} and {graph.ids[second]}"
        feedback = f"{pair} would come too close: one of them should yield, the other go faster."
    elif efficiency < parameters.min_efficiency:
        feedback = "All are too slow: who is not in the way of others should go faster."
    else:
        feedback = ""
    return Critique(safety, efficiency, feedback)


def _compute_mean_speed(member: NegotiationMember, points: Float) -> float:
    """Return the mean speed [m/s] of a trajectory."""
    steps = np.diff(np.vstack(((member.x, member.y), points)), axis=0)
    return float(portable.hypot(steps[:, 0], steps[:, 1]).mean()) / INTERVAL_S
