"""One CAV at the negotiating table: what it announces, and what the others' announcements mean for its plan."""

import math

import numpy as np

from mdrive_sumo.contract import Briefing, Observation, OwnState
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.negotiation.conflict_graph import compute_free_distance
from mdrive_sumo.negotiation.intention import INTERVAL_S, POINTS, classify_acceleration, classify_direction
from mdrive_sumo.negotiation.llm_negotiator import LlmNegotiator
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember, NegotiationStep
from mdrive_sumo.negotiation.peer_table import predict_announced_poses
from mdrive_sumo.negotiation.rule_negotiator import RuleNegotiator
from mdrive_sumo.planning.motion_prediction import TIMES, PredictedMotion, predict_yielding
from mdrive_sumo.planning.path_overlap import SafetyMargin
from mdrive_sumo.planning.reference_path import SPACING_M
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner, StopPoint
from mdrive_sumo.v2x.messages import Intention, Mcm

AHEAD_M = 30.0
"""The stretch of the way that tells where a car is heading."""
SAME_WAY_COS = 0.7
LEAD_M = 20.0
LANE_M = 1.5
"""Who is so near to my way, and at most so far ahead on it, leads me if he goes in my direction."""
TRUST_ROWS = int((TIMES <= 2.0).sum())
TRUST = SafetyMargin(0.6, 0.25)
"""Who has promised to let me go first is minded for two seconds, and kept clear of by so much less than others:
else both would wait for each other."""


class NegotiationInterface:
    """Between a negotiator and a planner.

    stops: who has to let others go first halts before he comes into their way, as the rule of the protocol (10.5) and
    the language model's STOP say; else he plans to pass behind them.
    """

    def __init__(self, briefing: Briefing, negotiator: RuleNegotiator | LlmNegotiator, stops: bool) -> None:
        self._me, self._negotiator, self._stops = briefing, negotiator, stops
        self._decision: NegotiationDecision | None = None

    def receive(self, seen: Observation) -> None:
        """Takes notice of the others' MCMs."""
        for message in seen.messages:
            self._negotiator.peers.receive(message)

    def predict_announced_motions(
        self, seen: Observation, planner: SpaceTimePlanner
    ) -> tuple[frozenset[str], list[PredictedMotion]]:
        """Who has announced his motion, and the motions that I have to mind."""
        said = self._said(seen.tick)
        motions = [motion for name, mcm in said.items() if (motion := self._minded(name, mcm, seen, planner))]
        return frozenset(said), motions

    def _said(self, tick: int) -> dict[str, Mcm]:
        heard = self._negotiator.peers.get_latest_mcms(tick)
        return {name: mcm for name, mcm in heard.items() if name != self._me.ego_id}

    def _minded(self, name: str, mcm: Mcm, seen: Observation, planner: SpaceTimePlanner) -> PredictedMotion | None:
        """An announced motion as I have to mind it; None for who comes behind me."""
        decision = self._decision or NegotiationDecision(Intention.KEEP)
        poses = predict_announced_poses(mcm, (seen.tick - mcm.pose.tick) * DT, TIMES)
        size = self._me.vehicle.length, self._me.vehicle.width
        if name not in decision.yield_to and _behind(seen.own, poses):
            return None
        if name in decision.priority_over:
            return PredictedMotion(poses[:TRUST_ROWS], size[0] - 2 * TRUST.longitudinal, size[1] - 2 * TRUST.lateral)
        if self._leads(poses, planner):
            return PredictedMotion(_braking(poses, mcm.speed), *size, stands_at_end=True)
        return PredictedMotion(poses, *size)

    def _leads(self, poses: Float, planner: SpaceTimePlanner) -> bool:
        """Whether somebody drives before me on my way: he may have to brake at any time, whatever he announced."""
        x, y, yaw = poses[0].tolist()
        s = planner.path.project(x, y, planner.s + LEAD_M, LEAD_M)
        path = planner.path
        row = int(s / SPACING_M)
        aside = abs(math.cos(path.yaw[row]) * (y - path.xy[row, 1]) - math.sin(path.yaw[row]) * (x - path.xy[row, 0]))
        return s > planner.s and aside < LANE_M and math.cos(yaw - path.yaw[row]) > SAME_WAY_COS

    def find_stop_points(self, seen: Observation, planner: SpaceTimePlanner) -> list[StopPoint]:
        """Where I have agreed to stop."""
        decision = self._decision
        if not self._stops or decision is None or decision.intention != Intention.STOP:
            return []
        members = {m.id: m for m in self._negotiator.peers.predict_members(seen.tick)}
        first = [members[name] for name in decision.yield_to if name in members]
        me = self._member(seen, planner, np.zeros((0, 2)))
        gap = compute_free_distance(me, first)
        until_s = (decision.until_tick - seen.tick) * DT
        return [StopPoint(planner.s + gap, until_s)] if math.isfinite(gap) else []

    def negotiate(self, seen: Observation, planner: SpaceTimePlanner, planned: Float) -> NegotiationStep:
        """The negotiator's turn: what it decides counts from the next plan on."""
        step = self._negotiator.step(seen.tick, self._member(seen, planner, planned), seen.messages)
        self._decision = step.decision
        return step

    def _member(self, seen: Observation, planner: SpaceTimePlanner, planned: Float) -> NegotiationMember:
        own, first = seen.own, int(planner.s / SPACING_M)
        return NegotiationMember(
            id=self._me.ego_id,
            x=own.x,
            y=own.y,
            yaw=own.yaw,
            speed=own.speed,
            intention=classify_acceleration(own.acceleration),
            direction=classify_direction(planner.path.xy[first : first + int(AHEAD_M / SPACING_M)]),
            interval_s=INTERVAL_S,
            desired=planner.predict_desired_points(own.speed, POINTS),
            planned=planned,
        )


def _braking(poses: Float, speed: float) -> Float:
    """The same way (T, 3), driven by one who brakes for me from now on."""
    steps = np.hypot(*np.diff(poses[:, :2], axis=0).T)
    s = np.concatenate(((0.0,), np.cumsum(steps)))
    braked = np.minimum(predict_yielding(speed) - float(predict_yielding(speed)[0]), s)
    yaw = np.unwrap(poses[:, 2])
    return np.column_stack([np.interp(braked, s, column) for column in (poses[:, 0], poses[:, 1], yaw)])


def _behind(own: OwnState, poses: Float) -> bool:
    """Whether somebody is behind me and goes my way: he minds me."""
    ahead = math.cos(own.yaw) * (poses[0, 0] - own.x) + math.sin(own.yaw) * (poses[0, 1] - own.y)
    return ahead < 0 and math.cos(poses[0, 2] - own.yaw) > SAME_WAY_COS
