"""`colmdriver`: negotiates by language model."""

from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, Option
from mdrive_sumo.negotiation import LlmNegotiator, NegotiationInterface, RuleNegotiator, read_llm_options
from mdrive_sumo.negotiation.language_model import LanguageModel
from mdrive_sumo.perception.object_tracker import ObjectTracker
from mdrive_sumo.planning.driving_options import DRIVING_OPTIONS, DrivingOptions
from mdrive_sumo.planning.ego_planner import EgoPlanner, exclude_objects
from mdrive_sumo.v2x.messages import MCM

COMPATIBILITY_OPTIONS = {"compat_ego0": Option(0, 0, 1)}
"""1: reproduce a defect of the original, see `RuleNegotiator`."""


class ColmdriverRuleAgent:
    """Own sensors, and MCMs by which the one nearest to the conflict goes first and all others stop (protocol 10.5)."""

    label = "negotiation"
    name = "colmdriver-rule"

    def __init__(self, config: Config) -> None:
        self._options = DrivingOptions(self.name, config, COMPATIBILITY_OPTIONS)
        self._compat_ego0 = bool(self._options.values.get("compat_ego0", 0))

    def build_negotiator(self, briefing: Briefing) -> RuleNegotiator | LlmNegotiator:
        """Return the negotiator that resolves the conflicts."""
        return RuleNegotiator(compat_ego0=self._compat_ego0, rate=briefing.v2x_rate)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensor of visible boxes."""
        return (self._options.build_sensor_spec(),)

    def start(self, briefing: Briefing) -> None:
        """Prepare the negotiation; the path needs the first observation, which has the heading of the car."""
        self._briefing = briefing = self._options.adapt_briefing(briefing)
        self._tracker = ObjectTracker(briefing, self._options.find_detector(briefing))
        self._negotiation = NegotiationInterface(briefing, self.build_negotiator(briefing), stops=True)
        self._ego_planner: EgoPlanner | None = None

    def act(self, seen: Observation) -> Reply:
        """Return the plan, updated when it is due, and messages with plan and claims."""
        if self._ego_planner is None:
            cruise_speed = self._options.find_cruise_speed(self._briefing)
            self._ego_planner = EgoPlanner(self._briefing, seen.own, cruise_speed)
        planner = self._ego_planner.planner
        notes = self._tracker.receive(message for message in seen.messages if message.type == MCM)
        self._negotiation.receive(seen)
        if self._ego_planner.track_ego(seen):
            names, motions = self._negotiation.predict_announced_motions(seen, planner)
            objects = self._tracker.update(seen)
            stop_points = self._negotiation.find_stop_points(seen, planner)
            others, sigmas = exclude_objects(objects, names), self._tracker.position_sigmas
            notes += self._ego_planner.update_plan(seen, others, motions, stop_points, sigmas)
        plan = planner.build_plan(seen.tick)
        step = self._negotiation.negotiate(seen, planner, plan.points)
        return Reply(plan=plan, messages=step.messages, notes=notes + step.notes)


DRIVING = (*DRIVING_OPTIONS, "detector")


class ColmdriverAgent(ColmdriverRuleAgent):
    """As `colmdriver-rule`, but a language model speaks for each CAV and says what was agreed (protocol 10.4)."""

    name = "colmdriver"

    def __init__(self, config: Config) -> None:
        negotiation = {name: value for name, value in config.items() if name not in DRIVING}
        self._settings, self._instant = read_llm_options(self.name, negotiation, DRIVING)
        super().__init__({name: value for name, value in config.items() if name in DRIVING})

    def build_negotiator(self, briefing: Briefing) -> LlmNegotiator:
        """Return a negotiator that asks the model; where it gives nothing usable the rule decides."""
        model = LanguageModel(self._settings, briefing.seed)
        return LlmNegotiator(model, self._instant, rate=briefing.v2x_rate)
