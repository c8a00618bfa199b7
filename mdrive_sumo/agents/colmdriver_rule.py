"""`colmdriver-rule`: negotiates by rule."""

from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, Option
from mdrive_sumo.negotiation import LlmNegotiator, Parley, RuleNegotiator
from mdrive_sumo.perception.fusion import Fusion
from mdrive_sumo.planning.ego_planner import Drive, Habits, without
from mdrive_sumo.v2x.messages import MCM

COMPAT = {"compat_ego0": Option(0, 0, 1)}
"""1: with the original's slip, see `RuleNegotiator`."""


class ColmdriverRuleAgent:
    """Own sensors, and MCMs by which the one nearest to the conflict goes first and all others stop (protocol 10.5)."""

    label = "negotiation"
    name = "colmdriver-rule"

    def __init__(self, config: Config) -> None:
        self._habits = Habits(self.name, config, COMPAT)
        self._compat = bool(self._habits.numbers.get("compat_ego0", 0))

    def negotiator(self, seed: int) -> RuleNegotiator | LlmNegotiator:  # noqa: ARG002  (a language model needs it)
        """Who settles the conflicts."""
        return RuleNegotiator(compat_ego0=self._compat)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Boxes of what is in sight."""
        return (self._habits.sensor(),)

    def start(self, briefing: Briefing) -> None:
        """The path needs the first observation: nobody says which way a car looks at its start."""
        self._me = briefing
        self._fusion = Fusion(briefing.vehicle)
        self._parley = Parley(briefing, self.negotiator(briefing.seed), stops=True)
        self._drive: Drive | None = None

    def act(self, seen: Observation) -> Reply:
        """The plan, made anew when it is time to, and what I plan and claim for the others."""
        drive = self._drive = self._drive or Drive(self._me, seen.own, self._habits.cruise)
        planner = drive.planner
        notes = self._fusion.hear(message for message in seen.messages if message.type == MCM)
        self._parley.hear(seen)
        if drive.due(seen):
            names, motions = self._parley.announced(seen, planner)
            objects = self._fusion.fused(seen.tick, seen.own, self._habits.current(seen))
            drive.step(seen, without(objects, names), motions, self._parley.barriers(seen, planner))
        plan = planner.plan(seen.tick)
        step = self._parley.step(seen, planner, plan.points)
        return Reply(plan=plan, messages=step.messages, notes=notes + step.notes)
