"""`sharing`: drives by its own detections and those that others share."""

from mdrive_sumo.contract import Briefing, Detections, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config
from mdrive_sumo.perception.object_tracker import ObjectTracker
from mdrive_sumo.planning.driving_options import DrivingOptions
from mdrive_sumo.planning.ego_planner import EgoPlanner
from mdrive_sumo.v2x.awareness_service import AwarenessService


class SharingAgent:
    """The planner and tracker of `single`, fed also with CAMs and CPMs of CAVs and road-side units."""

    label = "sharing"
    name = "sharing"

    def __init__(self, config: Config) -> None:
        self._options = DrivingOptions(self.name, config)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensor of visible boxes and of the free view."""
        return (self._options.build_sensor_spec(free_space=True),)

    def start(self, briefing: Briefing) -> None:
        """Prepare fusion and sending; the path needs the first observation, which has the heading of the car."""
        self._briefing = briefing = self._options.adapt_briefing(briefing)
        detector = self._options.find_detector(briefing)
        self._tracker = ObjectTracker(briefing, detector)
        self._awareness = AwarenessService(briefing, self._options.find_range(briefing), detector)
        self._ego_planner: EgoPlanner | None = None

    def act(self, seen: Observation) -> Reply:
        """Return the plan, updated when it is due, and messages with the own state and detections."""
        if self._ego_planner is None:
            cruise_speed = self._options.find_cruise_speed(self._briefing)
            self._ego_planner = EgoPlanner(self._briefing, seen.own, cruise_speed)
        notes = self._tracker.receive(seen.messages)
        detections = None
        if self._ego_planner.track_ego(seen):
            tracked = self._tracker.update(seen)
            detections = Detections.from_objects(tracked)
            notes += self._ego_planner.update_plan(seen, tracked, sigmas=self._tracker.position_sigmas)
        plan = self._ego_planner.planner.build_plan(seen.tick)
        messages = self._awareness.compose_messages(seen)
        return Reply(plan=plan, messages=messages, notes=notes, detections=detections)
