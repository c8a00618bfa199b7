"""One CAV's driving, whatever it knows the others by: what `single`, `sharing` and the negotiating agents share."""

from collections.abc import Collection, Sequence

from mdrive_sumo.agents.foresight import Foresight
from mdrive_sumo.agents.lines import Lines
from mdrive_sumo.agents.path import path_station
from mdrive_sumo.agents.planner import Barrier, Planner
from mdrive_sumo.agents.prediction import Motion
from mdrive_sumo.contract import Briefing, Objects, Observation, OwnState, TrafficLight

STOPPING = 4.0
"""[m/s2] A yellow light is minded by whoever can stop before it with this braking."""


class Drive:
    """The planner with its lines and its expectations of others."""

    def __init__(self, briefing: Briefing, own: OwnState, cruise: float) -> None:
        self._foresight = Foresight(briefing, cruise)
        self.planner = Planner(briefing, own.yaw, cruise)
        path = self.planner.path
        signs = [path_station(path, briefing, sign.s) for sign in briefing.stop_signs]
        lights = [TrafficLight(light.id, path_station(path, briefing, light.s)) for light in briefing.traffic_lights]
        self._lines = Lines(signs, lights)

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
        planner = self.planner
        motions, waits = self._foresight.outlook(seen.own, objects, planner)
        lines = self._lines_ahead(seen)
        planner.update(seen.tick, seen.own.speed, [*motions, *announced], [*waits, *lines, *barriers])

    def _lines_ahead(self, seen: Observation) -> list[Barrier]:
        """Stop signs and red lights."""
        here, speed = self.planner.s, seen.own.speed

        def can_stop(line: float) -> bool:
            return line > here and speed**2 / (2 * max(line - here, 0.5)) < STOPPING

        return [Barrier(line) for line in self._lines.stations(here, speed, seen.signals, can_stop)]


def without(objects: Objects, names: Collection[str]) -> Objects:
    """The objects but for those names."""
    return objects.picked([row for row, name in enumerate(objects.ids) if name not in names])
