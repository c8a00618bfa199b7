"""`sharing+negotiation`: perception sharing and negotiation together."""

from mdrive_sumo.agents.sharing import SharingAgent
from mdrive_sumo.contract import Briefing, Observation, Reply
from mdrive_sumo.negotiation import NegotiationInterface, RuleNegotiator
from mdrive_sumo.planning.ego_planner import EgoPlanner, exclude_objects


class SharingNegotiationAgent(SharingAgent):
    """Shares perception as `sharing` does, and settles by rule who passes behind whom: the paper's future work."""

    label = "negotiation"
    name = "sharing+negotiation"

    def start(self, briefing: Briefing) -> None:
        """As `sharing`, and takes a seat at the table."""
        super().start(briefing)
        self._parley = NegotiationInterface(briefing, RuleNegotiator(passing=True), stops=False)

    def act(self, seen: Observation) -> Reply:
        """The plan, made anew when it is time to, and what I see, plan and claim for the others."""
        drive = self._drive = self._drive or EgoPlanner(self._me, seen.own, self._habits.cruise_speed)
        planner = drive.planner
        notes = self._fusion.receive(seen.messages)
        self._parley.receive(seen)
        if drive.track_ego(seen):
            names, motions = self._parley.predict_announced_motions(seen, planner)
            objects = self._fusion.fuse(seen.tick, seen.own, self._habits.compensate_latency(seen))
            drive.update_plan(seen, exclude_objects(objects, names), motions)
        plan = planner.build_plan(seen.tick)
        step = self._parley.negotiate(seen, planner, plan.points)
        return Reply(plan=plan, messages=self._station.messages(seen) + step.messages, notes=notes + step.notes)
