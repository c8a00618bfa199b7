"""`single`: drives by its own sensors."""

from mdrive_sumo.contract import Briefing, Detections, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config
from mdrive_sumo.perception.object_tracker import ObjectTracker
from mdrive_sumo.planning.driving_options import DrivingOptions
from mdrive_sumo.planning.ego_planner import EgoPlanner


class SingleAgent:
    """Own sensors only: plans in space and time around what it sees and tracks, and yields by time-to-conflict."""

    label = "single"

    def __init__(self, config: Config) -> None:
        self._options = DrivingOptions("single", config)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Return the sensor of visible boxes."""
        return (self._options.build_sensor_spec(),)

    def start(self, briefing: Briefing) -> None:
        """Store the briefing; the path needs the first observation, because the briefing has no heading of the car."""
        self._briefing = briefing = self._options.adapt_briefing(briefing)
        self._tracker = ObjectTracker(briefing, self._options.find_detector(briefing))
        self._ego_planner: EgoPlanner | None = None

    def act(self, seen: Observation) -> Reply:
        """Return the plan, updated when it is due."""
        if self._ego_planner is None:
            cruise_speed = self._options.find_cruise_speed(self._briefing)
            self._ego_planner = EgoPlanner(self._briefing, seen.own, cruise_speed)
        detections, notes = None, ()
        if self._ego_planner.track_ego(seen):
            tracked = self._tracker.update(seen)
            detections = Detections.from_objects(tracked)
            notes = self._ego_planner.update_plan(seen, tracked, sigmas=self._tracker.position_sigmas)
        return Reply(plan=self._ego_planner.planner.build_plan(seen.tick), notes=notes, detections=detections)
