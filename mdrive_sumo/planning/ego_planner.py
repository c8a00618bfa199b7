"""One CAV's driving, whatever it knows the others by: what `single`, `sharing` and the negotiating agents share."""

from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import numpy as np

from mdrive_sumo.contract import Briefing, Objects, Observation, OwnState, SensorSpec
from mdrive_sumo.contract.agent_options import Choice, Config, Option, read_choice, read_options
from mdrive_sumo.contract.detector_profiles import IDEAL, LIDAR_SINGLE, PROFILES
from mdrive_sumo.core.state import DT
from mdrive_sumo.planning.interaction_prediction import Foresight
from mdrive_sumo.planning.motion_prediction import Motion
from mdrive_sumo.planning.obstacle_passing import Passing
from mdrive_sumo.planning.space_time_planner import Barrier, Planner
from mdrive_sumo.planning.stop_lines import Lines, lines_on

OPTIONS = MappingProxyType({"speed": Option(8.0, 2.0, 10.0), "range": Option(80.0, 5.0, 200.0)})
NO_OPTIONS: Mapping[str, Option] = MappingProxyType({})
DETECTOR = Choice(LIDAR_SINGLE, (LIDAR_SINGLE, IDEAL))
STOPPING = 4.0
"""[m/s2] A yellow light is minded by whoever can stop before it with this braking."""


class Habits:
    """How a baseline drives and what it drives by; the same options for all of them.

    speed: at most so fast [m/s]; range: how far it sees [m]; detector: how well, see docs/sensors.md.
    """

    def __init__(self, agent: str, config: Config, more: Mapping[str, Option] = NO_OPTIONS) -> None:
        """more: numbers that only this agent has; `numbers` holds their values. Raises InputError."""
        self.numbers = read_options(agent, config, {**OPTIONS, **more}, {"detector": DETECTOR})
        self.cruise, self.range_m = self.numbers["speed"], self.numbers["range"]
        self._detector = read_choice(agent, config, "detector", DETECTOR)

    def sensor(self, free_space: bool = False) -> SensorSpec:
        """Boxes of what is in sight, and (if asked for) how far sight is free."""
        return SensorSpec(
            "objects", range_m=self.range_m, options={"profile": self._detector, "free_space": free_space}
        )

    @property
    def latency_ticks(self) -> int:
        """How old what the detector tells is; its data sheet says so."""
        return PROFILES[self._detector].latency_ticks

    def current(self, seen: Observation) -> Objects:
        """The own detections, moved on to now."""
        assert seen.objects is not None, "the objects sensor is declared"
        return seen.objects.advance(self.latency_ticks * DT) if self.latency_ticks else seen.objects


class Drive:
    """The planner with its lines and its expectations of others."""

    def __init__(self, briefing: Briefing, own: OwnState, cruise: float) -> None:
        self.planner = Planner(briefing, own.yaw, cruise)
        self._foresight = Foresight(briefing, cruise)
        self._me, self._passing = briefing, Passing(briefing)
        self._lines: Lines = lines_on(self.planner.path, briefing)

    def due(self, seen: Observation) -> bool:
        """Takes notice of the own state; whether `step` is to be called in this tick."""
        self.planner.follow(seen.tick, seen.own)
        return self.planner.due(seen.tick)

    def step(
        self,
        seen: Observation,
        objects: Objects,
        announced: Sequence[Motion] = (),
        barriers: Sequence[Barrier] = (),
    ) -> None:
        """Brings the plan up to date.

        objects: whose motion must be guessed; announced: motions that are known; barriers: places to wait at.
        """
        planner, path = self.planner, self.planner.path
        lines = self._lines_ahead(seen)
        objects, holds = self._passing.step(seen, objects, planner, [line.s for line in lines])
        if planner.path is not path:
            self._lines = lines_on(planner.path, self._me)
            lines = self._lines_ahead(seen)
        motions, waits = self._foresight.outlook(seen.own, objects, planner)
        planner.update(seen.tick, seen.own.speed, [*motions, *announced], [*waits, *lines, *holds, *barriers])

    def _lines_ahead(self, seen: Observation) -> list[Barrier]:
        """Stop signs and red lights."""
        here, speed = self.planner.s, seen.own.speed

        def can_stop(line: float) -> bool:
            return line > here and speed**2 / (2 * max(line - here, 0.5)) < STOPPING

        return [Barrier(line) for line in self._lines.stations(here, speed, seen.signals, can_stop)]


def without(objects: Objects, names: Collection[str]) -> Objects:
    """The objects but for those names."""
    return objects.take(np.array([name not in names for name in objects.ids], dtype=np.bool_))
