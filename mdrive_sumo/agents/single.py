"""`single`: drives by what its own sensors see."""

from mdrive_sumo.agents.base import Config, Option, read_options
from mdrive_sumo.agents.drive import Drive
from mdrive_sumo.contract import Briefing, Observation, Reply, SensorSpec

import os
PROFILE = os.environ.get("PROF", "ideal")
OPTIONS = {"speed": Option(8.0, 2.0, 10.0), "range": Option(80.0, 5.0, 200.0)}


class SingleAgent:
    """Own sensors only: plans in space and time around what it sees, and yields by time-to-conflict."""

    label = "single"

    def __init__(self, config: Config) -> None:
        options = read_options("single", config, OPTIONS)
        self._cruise, self._range = options["speed"], options["range"]

    def sensors(self) -> tuple[SensorSpec, ...]:
        """Boxes of what is in sight."""
        return (SensorSpec("objects", range_m=self._range, options={"profile": PROFILE}),)

    def start(self, briefing: Briefing) -> None:
        """The path needs the first observation: nobody says which way a car looks at its start."""
        self._me = briefing
        self._drive: Drive | None = None

    def act(self, seen: Observation) -> Reply:
        """The plan as it is, made anew when it is time to."""
        assert seen.objects is not None, "the objects sensor is declared"
        drive = self._drive = self._drive or Drive(self._me, seen.own, self._cruise)
        drive.planner.follow(seen.tick, seen.own)
        if drive.planner.due(seen.tick):
            drive.step(seen, seen.objects)
        return Reply(plan=drive.planner.plan(seen.tick))
