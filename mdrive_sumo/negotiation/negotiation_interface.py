"""Connects a negotiator with a planner: the own announcements, and what those of others mean for the own plan."""

import math
from dataclasses import dataclass

import numpy as np

from mdrive_sumo.contract import Briefing, Cause, Observation, OwnState, Reason
from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.state import DT
from mdrive_sumo.negotiation.announcement import (
    predict_announced_braking,
    predict_announced_poses,
    read_announcement,
)
from mdrive_sumo.negotiation.conflict_graph import compute_free_distance
from mdrive_sumo.negotiation.intention import INTERVAL_S, POINTS, classify_acceleration, classify_direction
from mdrive_sumo.negotiation.llm_negotiator import LlmNegotiator
from mdrive_sumo.negotiation.negotiator import NegotiationDecision, NegotiationMember, NegotiationStep
from mdrive_sumo.negotiation.rule_negotiator import RuleNegotiator
from mdrive_sumo.planning.motion_prediction import TIMES, PredictedMotion
from mdrive_sumo.planning.reference_path import SPACING_M
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner
from mdrive_sumo.planning.stop_lines import StopPoint
from mdrive_sumo.v2x.messages import Intention


@dataclass(frozen=True, slots=True)
class InterfaceParameters:
    """Parameters of `NegotiationInterface`. All values are design choices (decision 012)."""

    direction_m: float = 30.0
    """Length of the path ahead from which the announced direction is classified."""
    same_direction_cos: float = 0.7
    """Cosine of the largest angle (46 degrees) between cars in the same direction."""
    leader_ahead_m: float = 20.0
    """A CAV at most this far ahead and this close to the own path, in the same direction, is a leader."""
    leader_lateral_m: float = 1.5
    """[m] Lateral distance of its centre from the own path: less than half a lane."""
    trust_s: float = 2.0
    """A CAV that yields is considered for this long only, and with a box smaller by these margins [m] on every side:
    otherwise both would wait for each other."""
    trust_longitudinal_m: float = 0.6
    trust_lateral_m: float = 0.25


INTERFACE = InterfaceParameters()


class NegotiationInterface:
    """Between a negotiator and a planner.

    stops: a CAV that has to yield halts before the paths meet, as the rule of the protocol (10.5) and the language
    model's STOP demand; otherwise it plans to pass behind the others. obeys: False: it negotiates and drives as if it
    had not.
    """

    def __init__(
        self,
        briefing: Briefing,
        negotiator: RuleNegotiator | LlmNegotiator,
        stops: bool,
        obeys: bool = True,
        parameters: InterfaceParameters = INTERFACE,
    ) -> None:
        self._briefing, self._negotiator, self._stops = briefing, negotiator, stops
        self._obeys, self._parameters = obeys, parameters
        self._decision: NegotiationDecision | None = None

    def receive(self, seen: Observation) -> None:
        """Store the MCMs of an observation."""
        for message in seen.messages:
            self._negotiator.peers.receive(message)

    def forget(self, station: str) -> None:
        """Drop what a station announced, as it is not believed any more."""
        self._negotiator.peers.forget(station)

    def predict_announced_motions(
        self, seen: Observation, planner: SpaceTimePlanner
    ) -> tuple[frozenset[str], list[PredictedMotion]]:
        """Return the CAVs that announced a motion, and the motions that the own plan must avoid."""
        payload_by_station = self._negotiator.peers.get_latest_payloads(seen.tick)
        payload_by_station.pop(self._briefing.ego_id, None)
        motions = [self._predict_motion(name, payload, seen, planner) for name, payload in payload_by_station.items()]
        return frozenset(payload_by_station), [motion for motion in motions if motion is not None]

    def _predict_motion(
        self, name: str, payload: bytes, seen: Observation, planner: SpaceTimePlanner
    ) -> PredictedMotion | None:
        """Return an announced motion as the own plan must avoid it; None for a CAV that follows."""
        decision = self._decision or NegotiationDecision(Intention.KEEP)
        parameters = self._parameters
        age_ticks = seen.tick - read_announcement(payload).mcm.pose.tick
        poses = predict_announced_poses(payload, age_ticks)
        length, width = self._briefing.vehicle.length, self._briefing.vehicle.width
        if name not in decision.yield_to and self._is_behind(seen.own, poses):
            return None
        if name in decision.priority_over:
            trusted = poses[: int((parameters.trust_s >= TIMES).sum())]
            length -= 2 * parameters.trust_longitudinal_m
            width -= 2 * parameters.trust_lateral_m
            return PredictedMotion(trusted, length, width, Reason(Cause.ANNOUNCED, (name,)))
        ahead_m = self._find_distance_ahead(poses, planner)
        if ahead_m is not None:
            braking = predict_announced_braking(payload, age_ticks)
            reason = Reason(Cause.FOLLOW, (name,), distance_m=max(ahead_m - length, 0.0))
            return PredictedMotion(braking, length, width, reason, stands_at_end=True)
        cause = Cause.AGREEMENT if name in decision.yield_to else Cause.ANNOUNCED
        return PredictedMotion(poses, length, width, Reason(cause, (name,)))

    def _find_distance_ahead(self, poses: Float, planner: SpaceTimePlanner) -> float | None:
        """Return how far [m] ahead on the own path a CAV drives: it may have to brake, whatever it announced.

        None for a CAV that is no leader.
        """
        x, y, yaw = poses[0].tolist()
        path, ahead_m = planner.path, self._parameters.leader_ahead_m * planner.scale.factor
        s = path.project(x, y, planner.s + ahead_m, ahead_m)
        row = int(s / SPACING_M)
        cos, sin = portable.cos_sin(path.yaw[row])
        lateral = cos * (y - path.xy[row, 1]) - sin * (x - path.xy[row, 0])
        is_aligned = portable.cos(yaw - path.yaw[row]) > self._parameters.same_direction_cos
        leads = s > planner.s and abs(lateral) < self._parameters.leader_lateral_m and is_aligned
        return s - planner.s if leads else None

    def _is_behind(self, own: OwnState, poses: Float) -> bool:
        """Return whether a CAV is behind and in the same direction: it gives way to the own car."""
        cos, sin = portable.cos_sin(own.yaw)
        ahead = cos * (poses[0, 0] - own.x) + sin * (poses[0, 1] - own.y)
        return ahead < 0 and portable.cos(poses[0, 2] - own.yaw) > self._parameters.same_direction_cos

    def find_stop_points(self, seen: Observation, planner: SpaceTimePlanner) -> list[StopPoint]:
        """Return where the own car has agreed to stop."""
        decision = self._decision
        if not self._stops or decision is None or decision.intention != Intention.STOP:
            return []
        member_by_id = {member.id: member for member in self._negotiator.peers.predict_members(seen.tick)}
        first = [member_by_id[name] for name in decision.yield_to if name in member_by_id]
        gap = compute_free_distance(self._build_member(seen, planner, np.zeros((0, 2))), first)
        if not math.isfinite(gap):
            return []
        until_s = (decision.until_tick - seen.tick) * DT
        reason = Reason(Cause.AGREEMENT, tuple(sorted(decision.yield_to)), distance_m=gap, seconds=until_s)
        return [StopPoint(planner.s + gap, reason, until_s)]

    def negotiate(self, seen: Observation, planner: SpaceTimePlanner, planned: Float) -> NegotiationStep:
        """Run the negotiator; its decision counts from the next plan on. planned: (K, 2) own positions [m]."""
        if not self._negotiator.is_due(seen.tick):
            decision = self._negotiator.get_valid_decision(seen.tick)
            self._decision = decision if self._obeys else None
            return NegotiationStep(decision)
        step = self._negotiator.step(seen.tick, self._build_member(seen, planner, planned), seen.messages)
        self._decision = step.decision if self._obeys else None
        return step

    def _build_member(self, seen: Observation, planner: SpaceTimePlanner, planned: Float) -> NegotiationMember:
        """Return the own car as a member of the negotiation."""
        own, first = seen.own, int(planner.s / SPACING_M)
        ahead = planner.path.xy[first : first + int(self._parameters.direction_m / SPACING_M)]
        return NegotiationMember(
            id=self._briefing.ego_id,
            x=own.x,
            y=own.y,
            yaw=own.yaw,
            speed=own.speed,
            intention=classify_acceleration(own.acceleration),
            direction=classify_direction(ahead),
            interval_s=INTERVAL_S,
            desired=planner.predict_desired_points(own.speed, POINTS),
            planned=planned,
            position_sigma=own.position_sigma,
            yaw_sigma=own.yaw_sigma,
        )
