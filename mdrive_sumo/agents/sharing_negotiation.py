"""`sharing+negotiation`: perception sharing and negotiation together."""

from mdrive_sumo.agents.sharing import SharingAgent
from mdrive_sumo.contract import Briefing, Detections, Observation, Reply
from mdrive_sumo.negotiation import NegotiationInterface, RuleNegotiator
from mdrive_sumo.planning.ego_planner import EgoPlanner, exclude_objects


class SharingNegotiationAgent(SharingAgent):
    """Shares perception as `sharing` does, and settles by rule which CAV passes first: the paper's future work."""

    label = "negotiation"
    name = "sharing+negotiation"

    def start(self, briefing: Briefing) -> None:
        """Prepare as `sharing` does, and the negotiation."""
        super().start(briefing)
        self._negotiation = NegotiationInterface(briefing, RuleNegotiator(passing=True), stops=False)

    def act(self, seen: Observation) -> Reply:
        """Return the plan, updated when it is due, and messages with detections, plan and claims."""
        if self._ego_planner is None:
            cruise_speed = self._options.find_cruise_speed(self._briefing)
            self._ego_planner = EgoPlanner(self._briefing, seen.own, cruise_speed)
        planner = self._ego_planner.planner
        notes = self._tracker.receive(seen.messages)
        self._negotiation.receive(seen)
        detections = None
        if self._ego_planner.track_ego(seen):
            names, motions = self._negotiation.predict_announced_motions(seen, planner)
            tracked = self._tracker.update(seen)
            detections = Detections.from_objects(tracked)
            others = exclude_objects(tracked, names)
            notes += self._ego_planner.update_plan(seen, others, motions, sigmas=self._tracker.position_sigmas)
        plan = planner.build_plan(seen.tick)
        step = self._negotiation.negotiate(seen, planner, plan.points)
        messages = self._awareness.compose_messages(seen) + step.messages
        return Reply(plan=plan, messages=messages, notes=notes + step.notes, detections=detections)
