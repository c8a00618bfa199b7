"""`sharing`: drives by what it and the others see."""

from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec
from mdrive_sumo.contract.agent_options import Config
from mdrive_sumo.perception.late_fusion import LateFusion
from mdrive_sumo.planning.ego_planner import DrivingOptions, EgoPlanner
from mdrive_sumo.v2x.awareness_service import AwarenessService


class SharingAgent:
    """The planner of `single`, fed by own detections fused with CAMs and CPMs of CAVs and road-side units."""

    label = "sharing"
    name = "sharing"

    def __init__(self, config: Config) -> None:
        self._habits = DrivingOptions(self.name, config)

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Boxes of what is in sight, and how far sight is free."""
        return (self._habits.build_sensor_spec(free_space=True),)

    def start(self, briefing: Briefing) -> None:
        """The path needs the first observation: nobody says which way a car looks at its start."""
        self._me = briefing
        self._fusion = LateFusion(briefing.vehicle)
        self._station = AwarenessService(briefing, self._habits.range_m, self._habits.latency_ticks)
        self._drive: EgoPlanner | None = None

    def act(self, seen: Observation) -> Reply:
        """The plan as it is, made anew when it is time to, and what I see for the others."""
        drive = self._drive = self._drive or EgoPlanner(self._me, seen.own, self._habits.cruise_speed)
        notes = self._fusion.receive(seen.messages)
        if drive.track_ego(seen):
            drive.update_plan(seen, self._fusion.fuse(seen.tick, seen.own, self._habits.compensate_latency(seen)))
        return Reply(plan=drive.planner.build_plan(seen.tick), messages=self._station.messages(seen), notes=notes)
