"""`colmdriver-rule`: negotiates by rule."""

from mdrive_sumo.agents.base import Config, Option, read_options
from mdrive_sumo.agents.drive import Drive, without
from mdrive_sumo.agents.fusion import Fusion
from mdrive_sumo.agents.negotiation import RuleNegotiator
from mdrive_sumo.agents.negotiation.llm import LlmNegotiator
from mdrive_sumo.agents.negotiation.parley import Parley
from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.v2x.messages import MCM

RANGE_M = 80.0
OPTIONS = {"speed": Option(8.0, 2.0, 10.0), "compat_ego0": Option(0, 0, 1)}


class ColmdriverRuleAgent:
    """Own sensors, and MCMs by which the one nearest to the conflict goes first and all others stop (protocol 10.5)."""

    label = "negotiation"

    def __init__(self, config: Config) -> None:
        options = read_options("colmdriver-rule", config, OPTIONS)
        self._cruise, self._compat = options["speed"], bool(options["compat_ego0"])

    def negotiator(self, briefing: Briefing) -> RuleNegotiator | LlmNegotiator:
        """Who settles the conflicts."""
        return RuleNegotiator(compat_ego0=self._compat)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Boxes of what is in sight."""
        return (SensorSpec("objects", range_m=RANGE_M),)

    def start(self, briefing: Briefing) -> None:
        """The path needs the first observation: nobody says which way a car looks at its start."""
        self._me = briefing
        self._fusion = Fusion(briefing.vehicle)
        self._parley = Parley(briefing, self.negotiator(briefing), stops=True)
        self._drive: Drive | None = None

    def act(self, seen: Observation) -> Reply:
        """The plan, made anew when it is time to, and what I plan and claim for the others."""
        assert seen.objects is not None, "the objects sensor is declared"
        drive = self._drive = self._drive or Drive(self._me, seen.own, self._cruise)
        planner = drive.planner
        planner.follow(seen.tick, seen.own)
        notes = self._fusion.hear(m for m in seen.messages if m.type == MCM)
        self._parley.hear(seen)
        if planner.due(seen.tick):
            names, motions = self._parley.announced(seen, planner)
            objects = self._fusion.fused(seen.tick, seen.own, seen.objects)
            drive.step(seen, without(objects, names), motions, self._parley.barriers(seen, planner))
        plan = planner.plan(seen.tick)
        step = self._parley.step(seen, planner, plan.points)
        return Reply(plan=plan, messages=step.messages, notes=notes + step.notes)
