"""Planning for one CAV from a list of objects: what `single`, `sharing` and the negotiating agents have in common."""

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from mdrive_sumo.contract import Briefing, Note, Objects, Observation, OwnState, ReasonLog
from mdrive_sumo.planning.interaction_prediction import EXACT, InteractionPredictor
from mdrive_sumo.planning.motion_prediction import PredictedMotion
from mdrive_sumo.planning.obstacle_avoidance import ObstacleAvoidance
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner
from mdrive_sumo.planning.stop_lines import StopLines, StopPoint, build_stop_lines


class EgoPlanner:
    """The space-time planner with stop lines, obstacle avoidance and predictions of other road users."""

    def __init__(self, briefing: Briefing, own: OwnState, cruise_speed: float) -> None:
        """Build the path from the car's present state; cruise_speed [m/s]."""
        self.planner = SpaceTimePlanner(briefing, own.yaw, cruise_speed)
        self._predictor = InteractionPredictor(briefing, cruise_speed, self.planner.scale)
        self._briefing, self._avoidance = briefing, ObstacleAvoidance(briefing, self.planner.scale)
        self._stop_lines: StopLines = build_stop_lines(self.planner.path, briefing)
        self._reasons = ReasonLog()

    def track_ego(self, seen: Observation) -> bool:
        """Update the own station; return whether `update_plan` must be called in this tick."""
        self.planner.track_ego(seen.tick, seen.own)
        return self.planner.is_update_due(seen.tick)

    def update_plan(
        self,
        seen: Observation,
        objects: Objects,
        announced: Sequence[PredictedMotion] = (),
        stop_points: Sequence[StopPoint] = (),
        sigmas: Mapping[str, float] = EXACT,
    ) -> tuple[Note, ...]:
        """Update the plan; return the note of what limits it, if that is something else than before.

        objects: road users whose motion has to be predicted; announced: known motions of others; stop_points: further
        places to wait at; sigmas: standard deviation [m] of the position of objects by id, 0 for the others.
        """
        planner, path = self.planner, self.planner.path
        line_stops = self._find_line_stops(seen)
        stations = [stop.s for stop in line_stops]
        objects, obstacle_stops = self._avoidance.update(seen, objects, planner, stations)
        if planner.path is not path:
            self._stop_lines = build_stop_lines(planner.path, self._briefing)
            line_stops = self._find_line_stops(seen)
        motions, yield_stops = self._predictor.predict(seen.own, objects, planner, sigmas)
        stops = [*yield_stops, *line_stops, *obstacle_stops, *stop_points]
        planner.update(seen.tick, seen.own.speed, [*motions, *announced], stops)
        return self._reasons.record(planner.reason)

    def _find_line_stops(self, seen: Observation) -> list[StopPoint]:
        """Return the stop signs and red lights ahead."""
        return self._stop_lines.find_stops(self.planner.s, seen.own.speed, seen.signals)


def exclude_objects(objects: Objects, ids: Collection[str]) -> Objects:
    """Return the objects whose id is not in `ids`."""
    if not any(name in ids for name in objects.ids):
        return objects
    return objects.take(np.array([name not in ids for name in objects.ids], dtype=np.bool_))
