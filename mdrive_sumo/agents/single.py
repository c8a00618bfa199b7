"""`single`: drives by what its own sensors see."""

from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config
from mdrive_sumo.planning.ego_planner import DrivingOptions, EgoPlanner


class SingleAgent:
    """Own sensors only: plans in space and time around what it sees, and yields by time-to-conflict."""

    label = "single"

    def __init__(self, config: Config) -> None:
        self._habits = DrivingOptions("single", config)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Boxes of what is in sight."""
        return (self._habits.build_sensor_spec(),)

    def start(self, briefing: Briefing) -> None:
        """The path needs the first observation: nobody says which way a car looks at its start."""
        self._me = briefing
        self._drive: EgoPlanner | None = None

    def act(self, seen: Observation) -> Reply:
        """The plan as it is, made anew when it is time to."""
        drive = self._drive = self._drive or EgoPlanner(self._me, seen.own, self._habits.cruise_speed)
        if drive.track_ego(seen):
            drive.update_plan(seen, self._habits.compensate_latency(seen))
        return Reply(plan=drive.planner.build_plan(seen.tick))
