"""`sharing+negotiation`: perception sharing and negotiation together."""

from mdrive_sumo.agents.sharing import SharingAgent
from mdrive_sumo.contract import Briefing, Observation, Reply
from mdrive_sumo.negotiation import Parley, RuleNegotiator
from mdrive_sumo.planning.ego_planner import Drive, without


class SharingNegotiationAgent(SharingAgent):
    """Shares perception as `sharing` does, and settles by rule who passes behind whom: the paper's future work."""

    label = "negotiation"
    name = "sharing+negotiation"

    def start(self, briefing: Briefing) -> None:
        """As `sharing`, and takes a seat at the table."""
        super().start(briefing)
        self._parley = Parley(briefing, RuleNegotiator(passing=True), stops=False)

    def act(self, seen: Observation) -> Reply:
        """The plan, made anew when it is time to, and what I see, plan and claim for the others."""
        drive = self._drive = self._drive or Drive(self._me, seen.own, self._habits.cruise)
        planner = drive.planner
        notes = self._fusion.hear(seen.messages)
        self._parley.hear(seen)
        if drive.due(seen):
            names, motions = self._parley.announced(seen, planner)
            objects = self._fusion.fused(seen.tick, seen.own, self._habits.current(seen))
            drive.step(seen, without(objects, names), motions)
        plan = planner.plan(seen.tick)
        step = self._parley.step(seen, planner, plan.points)
        return Reply(plan=plan, messages=self._station.messages(seen) + step.messages, notes=notes + step.notes)
