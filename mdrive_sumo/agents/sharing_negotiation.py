"""`sharing+negotiation`: perception sharing and negotiation together."""

from mdrive_sumo.agents.base import Config
from mdrive_sumo.agents.drive import Drive, Habits, without
from mdrive_sumo.agents.fusion import Fusion
from mdrive_sumo.agents.negotiation import Parley, RuleNegotiator
from mdrive_sumo.agents.station import Station
from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec


class SharingNegotiationAgent:
    """Shares perception as `sharing` does, and settles by rule who passes behind whom: the paper's future work."""

    label = "negotiation"

    def __init__(self, config: Config) -> None:
        self._habits = Habits("sharing+negotiation", config)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Boxes of what is in sight, and how far sight is free."""
        return (self._habits.sensor(free_space=True),)

    def start(self, briefing: Briefing) -> None:
        """The path needs the first observation: nobody says which way a car looks at its start."""
        self._me = briefing
        self._fusion = Fusion(briefing.vehicle)
        self._station = Station(briefing, self._habits.range_m, self._habits.latency_ticks)
        self._parley = Parley(briefing, RuleNegotiator(passing=True), stops=False)
        self._drive: Drive | None = None

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
