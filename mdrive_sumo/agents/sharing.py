"""`single`, `sharing` and `sharing+negotiation`: one driver by own detections, those of others, agreements."""

from collections.abc import Mapping

from mdrive_sumo.contract import Briefing, Detections, Note, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config, Option
from mdrive_sumo.core.frozen import build_frozen
from mdrive_sumo.negotiation import LlmNegotiator, NegotiationInterface, RuleNegotiator
from mdrive_sumo.perception.message_guard import MessageGuard
from mdrive_sumo.perception.object_tracker import ObjectTracker
from mdrive_sumo.planning.driving_options import DrivingOptions
from mdrive_sumo.planning.ego_planner import EgoPlanner, exclude_objects
from mdrive_sumo.planning.motion_prediction import PredictedMotion
from mdrive_sumo.planning.warned_motion import predict_braking_station
from mdrive_sumo.v2x.awareness_service import AwarenessService
from mdrive_sumo.v2x.messages import MCM, EventCause
from mdrive_sumo.v2x.services.event_table import EventTable


class SingleAgent:
    """Own sensors only: plans in space and time around what it sees and tracks, and yields by time-to-conflict."""

    label = "single"
    name = "single"

    def __init__(self, config: Config) -> None:
        self._options = DrivingOptions(self.name, config)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensor of visible boxes."""
        return (self._options.build_sensor_spec(),)

    def start(self, briefing: Briefing) -> None:
        """Prepare the tracker; the path needs the first observation, because the briefing has no heading of the car."""
        self._briefing = briefing = self._options.adapt_briefing(briefing)
        self._tracker = ObjectTracker(briefing, self._options.find_detector(briefing))
        self._ego_planner: EgoPlanner | None = None

    def _get_planner(self, seen: Observation) -> EgoPlanner:
        """Return the planner, built at the first observation."""
        if self._ego_planner is None:
            cruise_speed = self._options.find_cruise_speed(self._briefing)
            self._ego_planner = EgoPlanner(self._briefing, seen.own, cruise_speed)
        return self._ego_planner

    def _predict_warned_motions(self, seen: Observation) -> Mapping[str, PredictedMotion]:  # noqa: ARG002
        """Return the motions of which others have warned, by station; an agent without messages knows of none."""
        return {}

    def act(self, seen: Observation) -> Reply:
        """Return the plan, updated when it is due."""
        car, detections = self._get_planner(seen), None
        notes: tuple[Note, ...] = ()
        if car.track_ego(seen):
            warned = self._predict_warned_motions(seen)
            tracked = self._tracker.update(seen)
            detections = Detections.from_objects(tracked)
            others = exclude_objects(tracked, warned)
            notes = car.update_plan(seen, others, [*warned.values()], sigmas=self._tracker.position_sigmas)
        return build_frozen(Reply, None, car.planner.build_plan(seen.tick), (), notes, detections)


DEFENCE = {"defence": Option(1, 0, 1, is_switch=True)}
"""0: believe every sender, also those that the own sensor contradicts; see docs/defence.md."""


class SharingAgent(SingleAgent):
    """The planner and tracker of `single`, fed also with CAMs, CPMs and DENMs of CAVs and road-side units."""

    label = "sharing"
    name = "sharing"

    def __init__(self, config: Config) -> None:
        self._options = DrivingOptions(self.name, config, DEFENCE)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensor of visible boxes and of the free view."""
        return (self._options.build_sensor_spec(free_space=True),)

    def start(self, briefing: Briefing) -> None:
        """Prepare as `single` does, and the sending."""
        super().start(briefing)
        detector = self._options.find_detector(self._briefing)
        self._awareness = AwarenessService(self._briefing, self._options.find_range(self._briefing), detector)
        self._events = EventTable()
        is_defended = bool(self._options.values["defence"])
        self._guard = MessageGuard(detector, self._briefing.v2x_rate) if is_defended else None

    def _screen_messages(self, seen: Observation) -> tuple[Observation, tuple[Note, ...]]:
        """Return the observation with the messages that are believed, and notes of senders that no longer are."""
        if self._guard is None:
            return seen, ()
        seen, fallen, notes = self._guard.screen(seen)
        for sender in sorted(fallen):
            self._forget_sender(sender)
        return seen, notes

    def _forget_sender(self, sender: str) -> None:
        self._tracker.drop_source(sender)
        self._events.forget(sender)

    def _receive(self, seen: Observation) -> tuple[Note, ...]:
        """Store what others report; return notes on new warnings and unreadable messages."""
        return self._tracker.receive(seen.messages) + self._events.receive(seen.messages)

    def _predict_warned_motions(self, seen: Observation) -> Mapping[str, PredictedMotion]:
        """Return the motions of the stations that have warned of their emergency braking."""
        events = self._events.find_events(seen.tick, EventCause.DANGEROUS_SITUATION)
        return {name.sender: predict_braking_station(name.sender, denm, seen.tick) for name, denm in events.items()}

    def act(self, seen: Observation) -> Reply:
        """Return the plan, updated when it is due, and messages with the own state and detections."""
        seen, notes = self._screen_messages(seen)
        notes += self._receive(seen)
        reply = super().act(seen)
        messages = self._awareness.compose_messages(seen)
        return build_frozen(Reply, None, reply.plan, messages, notes + reply.notes, reply.detections)


SHARE = {"share": Option(1, 0, 1, is_switch=True)}
"""0: negotiate by MCMs alone, and neither send nor use CAMs, CPMs and DENMs."""


class NegotiatingAgent(SharingAgent):
    """The body of all that settle by messages which CAV passes first; its negotiator says how."""

    label = "negotiation"
    stops = True
    """See `NegotiationInterface`."""

    def __init__(self, config: Config, own_options: Mapping[str, Option]) -> None:
        self._options = DrivingOptions(self.name, config, {**DEFENCE, **own_options})
        self._shares = bool(self._options.values.get("share", 1))
        self._obeys = bool(self._options.values.get("obey", 1))

    def build_negotiator(self, briefing: Briefing) -> RuleNegotiator | LlmNegotiator:
        """Return the negotiator that resolves the conflicts."""
        raise NotImplementedError

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensor of visible boxes, with the free view for CPMs."""
        return (self._options.build_sensor_spec(free_space=self._shares),)

    def start(self, briefing: Briefing) -> None:
        """Prepare as `sharing` does, and the negotiation."""
        super().start(briefing)
        if not self._shares:
            self._guard = None
        self._negotiation = NegotiationInterface(briefing, self.build_negotiator(briefing), self.stops, self._obeys)

    def _forget_sender(self, sender: str) -> None:
        super()._forget_sender(sender)
        if self._guard is not None and not self._guard.is_believed(sender):
            self._negotiation.forget(sender)

    def _receive(self, seen: Observation) -> tuple[Note, ...]:
        if self._shares:
            return super()._receive(seen)
        return self._tracker.receive(message for message in seen.messages if message.type == MCM)

    def act(self, seen: Observation) -> Reply:
        """Return the plan, updated when it is due, and messages with detections, plan and claims."""
        car, detections = self._get_planner(seen), None
        planner = car.planner
        seen, notes = self._screen_messages(seen)
        notes += self._receive(seen)
        self._negotiation.receive(seen)
        if car.track_ego(seen):
            names, motions = self._negotiation.predict_announced_motions(seen, planner)
            tracked = self._tracker.update(seen)
            detections = Detections.from_objects(tracked)
            warned = self._predict_warned_motions(seen)
            motions += [motion for name, motion in warned.items() if name not in names]
            others = exclude_objects(tracked, names | warned.keys())
            stop_points = self._negotiation.find_stop_points(seen, planner)
            notes += car.update_plan(seen, others, motions, stop_points, self._tracker.position_sigmas)
        plan = planner.build_plan(seen.tick)
        step = self._negotiation.negotiate(seen, planner, plan.points)
        messages = self._awareness.compose_messages(seen) if self._shares else ()
        return build_frozen(Reply, None, plan, messages + step.messages, notes + step.notes, detections)


class SharingNegotiationAgent(NegotiatingAgent):
    """Shares perception as `sharing` does, and settles by rule which CAV passes first: the paper's future work."""

    name = "sharing+negotiation"
    stops = False

    def __init__(self, config: Config) -> None:
        super().__init__(config, {})

    def build_negotiator(self, briefing: Briefing) -> RuleNegotiator:
        """Return a negotiator by whose rule no CAV has to stop."""
        return RuleNegotiator(passing=True, rate=briefing.v2x_rate)
