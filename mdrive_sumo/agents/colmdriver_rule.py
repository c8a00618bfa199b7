"""`colmdriver-rule`: negotiates by rule."""

from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, Option
from mdrive_sumo.negotiation import LlmNegotiator, NegotiationInterface, RuleNegotiator
from mdrive_sumo.perception.late_fusion import LateFusion
from mdrive_sumo.planning.ego_planner import DrivingOptions, EgoPlanner, exclude_objects
from mdrive_sumo.v2x.messages import MCM

COMPAT = {"compat_ego0": Option(0, 0, 1)}
"""1: with the original's slip, see `RuleNegotiator`."""


class ColmdriverRuleAgent:
    """Own sensors, and MCMs by which the one nearest to the conflict goes first and all others stop (protocol 10.5)."""

    label = "negotiation"
    name = "colmdriver-rule"

    def __init__(self, config: Config) -> None:
        self._habits = DrivingOptions(self.name, config, COMPAT)
        self._compat = bool(self._habits.values.get("compat_ego0", 0))

    def negotiator(self, seed: int) -> RuleNegotiator | LlmNegotiator:  # noqa: ARG002  (a language model needs it)
        """Who settles the conflicts."""
        return RuleNegotiator(compat_ego0=self._compat)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Boxes of what is in sight."""
        return (self._habits.build_sensor_spec(),)

    def start(self, briefing: Briefing) -> None:
        """The path needs the first observation: nobody says which way a car looks at its start."""
        self._me = briefing
        self._fusion = LateFusion(briefing.vehicle)
        self._parley = NegotiationInterface(briefing, self.negotiator(briefing.seed), stops=True)
        self._drive: EgoPlanner | None = None

    def act(self, seen: Observation) -> Reply:
        """The plan, made anew when it is time to, and what I plan and claim for the others."""
        drive = self._drive = self._drive or EgoPlanner(self._me, seen.own, self._habits.cruise_speed)
        planner = drive.planner
        notes = self._fusion.receive(message for message in seen.messages if message.type == MCM)
        self._parley.receive(seen)
        if drive.track_ego(seen):
            names, motions = self._parley.predict_announced_motions(seen, planner)
            objects = self._fusion.fuse(seen.tick, seen.own, self._habits.compensate_latency(seen))
            drive.update_plan(
                seen, exclude_objects(objects, names), motions, self._parley.find_stop_points(seen, planner)
            )
        plan = planner.build_plan(seen.tick)
        step = self._parley.negotiate(seen, planner, plan.points)
        return Reply(plan=plan, messages=step.messages, notes=notes + step.notes)
