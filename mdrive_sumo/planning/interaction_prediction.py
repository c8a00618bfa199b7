"""Predicted motions of observed road users: time-to-conflict, right of way, and a safe distance."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType

import numpy as np

from mdrive_sumo.contract import Briefing, Cause, Objects, OwnState, Reason
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Float, wrap_angle
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning import right_of_way
from mdrive_sumo.planning.motion_prediction import (
    TIMES,
    PredictedMotion,
    get_top_speed,
    place_on_arc,
    place_on_path,
    predict_acceleration,
    predict_constant_speed,
    predict_hesitation,
    predict_yielding,
)
from mdrive_sumo.planning.parameters import (
    INTERACTION,
    MOTION,
    PLANNER,
    InteractionParameters,
)
from mdrive_sumo.planning.planning_scale import PROTOCOL_SCALE, PlanningScale
from mdrive_sumo.planning.reference_path import SPACING_M, ReferencePath
from mdrive_sumo.planning.road_direction import align_with_road, build_road_direction
from mdrive_sumo.planning.space_time_planner import SpaceTimePlanner
from mdrive_sumo.planning.stop_lines import StopPoint

EXACT: Mapping[str, float] = MappingProxyType({})
"""Standard deviations of objects whose position is exact."""
RELIABLE_ROWS = int((MOTION.reliable_s >= TIMES).sum())
"""Rows of a prediction within `MotionParameters.reliable_s`."""


@dataclass(frozen=True, slots=True)
class QueueGapParameters:
    """The least gap to a vehicle ahead, moving or standing, whatever smaller margin the planner has at that time."""

    exact_m: float = PLANNER.min_margin.longitudinal
    """If the position of the vehicle is exact, ..."""
    sigmas: float = 4.0
    """... and so many standard deviations of its estimated position more: a car that waits plans twice a second and
    never drives back, so that the largest of many errors counts. Tracks 6 m away, detector `lidar-single`: standard
    deviation 0.16 m, largest error of the rear end 0.44 m in 40 s at walking pace."""
    most_m: float = 1.5
    """Not more than this: the position of a vehicle that is not seen any more becomes uncertain within a second."""


QUEUE_GAP = QueueGapParameters()


def compute_queue_gap(sigma: float, parameters: QueueGapParameters = QUEUE_GAP) -> float:
    """Return the gap [m] to a vehicle ahead whose estimated position has that standard deviation [m]."""
    return min(parameters.exact_m + parameters.sigmas * sigma, parameters.most_m)


class InteractionPredictor:
    """Predicts road users whose intentions are unknown, as a careful driver does.

    A road user that reaches a shared area before the own car goes first and is predicted to continue; one that reaches
    it later is predicted to brake. A road user ahead on the own path may brake at any time.
    """

    def __init__(
        self,
        briefing: Briefing,
        cruise_speed: float,
        scale: PlanningScale = PROTOCOL_SCALE,
        parameters: InteractionParameters = INTERACTION,
    ) -> None:
        self._briefing, self._cruise_speed, self._parameters = briefing, cruise_speed, parameters
        self._scale = scale
        self._road = None if scale.is_protocol else build_road_direction(briefing)
        self._curvatures = right_of_way.CurvatureEstimator()
        self._yielding = right_of_way.YieldingPolicy(briefing.seed)
        self._elapsed_s = PLANNER.check_ticks * briefing.tick_s

    def predict(
        self, own: OwnState, objects: Objects, planner: SpaceTimePlanner, sigmas: Mapping[str, float] = EXACT
    ) -> tuple[list[PredictedMotion], list[StopPoint]]:
        """Return the motions of all relevant objects, and the points at which to wait for those that go first.

        sigmas: standard deviation [m] of the position of objects by id, 0 for the others.
        """
        position, speed = (own.x, own.y), max(own.speed, 0.0)
        ego = right_of_way.EgoMotion(position, speed, self._cruise_speed, self._parameters.acceleration)
        preview = right_of_way.preview_path(planner.path, planner.s, self._briefing.vehicle, self._scale.right_of_way)
        curvature = self._curvatures.update(objects, self._elapsed_s)
        if self._road is not None:
            objects, curvature = align_with_road(self._road, planner.path, objects, curvature)
        on_path = right_of_way.find_rows_on_path(ego, preview, objects).tolist()
        look_m, own_length = self._scale.right_of_way.look_ahead_m, self._briefing.vehicle.length
        places = [
            (row, planner.path, planner.s, look_m, own_length, sigmas.get(objects.ids[row], 0.0)) for row in on_path
        ]
        motions = [predict_lead_object(objects, *place, self._parameters) for place in places]
        yields_to_ego = right_of_way.find_followers_beside(ego, preview, objects)
        same_direction = right_of_way.find_same_direction(preview, objects)
        row_by_id = {name: row for row, name in enumerate(objects.ids) if row not in on_path and not yields_to_ego[row]}
        predicted = right_of_way.find_crossing_conflicts(preview, objects, curvature, self._scale.right_of_way)
        conflicts = [conflict for conflict in predicted if conflict.begin_m > 0 and conflict.id in row_by_id]
        crossing = [conflict for conflict in conflicts if not same_direction[row_by_id[conflict.id]]]
        first = self._yielding.select_first(ego, crossing, self._elapsed_s)
        for conflict in conflicts:
            row = row_by_id[conflict.id]
            if same_direction[row]:
                motions.append(predict_merging(objects, row, float(curvature[row])))
            else:
                top_speed = get_top_speed(objects, row, self._scale.others_top_speed)
                motions.append(predict_crossing(objects, row, float(curvature[row]), conflict.id in first, top_speed))
        yielded_to = [conflict for conflict in conflicts if conflict.id in first]
        stops = [stop for conflict in yielded_to for stop in self._build_stop_points(conflict, ego, planner.s)]
        return motions, stops

    def _build_stop_points(
        self, conflict: right_of_way.CrossingConflict, ego: right_of_way.EgoMotion, s: float
    ) -> list[StopPoint]:
        """Return where to wait for a road user that goes first; empty if the own car can no longer stop there."""
        parameters = self._parameters
        stop_m = (ego.speed * ego.speed) / (2 * parameters.hard_braking)
        latest_m = conflict.begin_m - parameters.crossing_gap_m
        if latest_m < stop_m:
            return []
        gap = max(conflict.begin_m - parameters.turning_room_m, min(stop_m + parameters.min_wait_gap_m, latest_m))
        arrives_s = None if conflict.is_standing else conflict.arrives_s
        reason = Reason(Cause.YIELD, (conflict.id,), conflict.position, gap, arrives_s)
        return [StopPoint(s + gap, reason, conflict.leaves_s)]


@twin
def predict_lead_object(
    objects: Objects,
    row: int,
    path: ReferencePath,
    s: float,
    look_m: float,
    own_length: float,
    sigma: float,
    parameters: InteractionParameters,
    /,
) -> PredictedMotion:
    """Return the motion of an object on the own path: it brakes from now on.

    s: own station [m]; look_m: how far ahead the object may be [m]; sigma: standard deviation of its position [m].
    """
    speed = float(objects.speed[row])
    station = path.project(float(objects.x[row]), float(objects.y[row]), s + look_m / 2, look_m)
    yaw = float(np.interp(station, np.arange(len(path.xy)) * SPACING_M, path.yaw))
    travelled = predict_yielding(speed)
    aligned = abs(wrap_angle(float(objects.yaw[row]) - yaw)) < parameters.same_direction_rad
    moves = aligned and abs(speed) > MOTION.standing_speed
    poses = place_on_path(path, station, travelled) if moves else place_on_arc(objects, row, travelled, 0.0)
    gap_m = station - s - (own_length + float(objects.length[row])) / 2
    reason = _build_reason(objects, row, Cause.FOLLOW if moves else Cause.BLOCKED, distance_m=max(gap_m, 0.0))
    motion = _build_motion(objects, row, poses, reason)
    leads = aligned and objects.kind[row] != Kind.STATIC
    return replace(motion, min_gap_m=compute_queue_gap(sigma)) if leads else motion


@twin
def predict_merging(objects: Objects, row: int, curvature: float, /) -> PredictedMotion:
    """Return the motion of a vehicle ahead whose path joins the own path."""
    speed = float(objects.speed[row])
    bounds = predict_hesitation(speed), predict_constant_speed(speed)
    return _predict_between(objects, row, bounds, curvature, _build_reason(objects, row, Cause.AVOID))


@twin
def predict_crossing(
    objects: Objects, row: int, curvature: float, goes_first: bool, top_speed: float, /
) -> PredictedMotion:
    """Return the motion of a road user whose path crosses the own path and that accelerates to `top_speed` [m/s]."""
    speed = float(objects.speed[row])
    reason = _build_reason(objects, row, Cause.YIELD if goes_first else Cause.AVOID)
    if not goes_first:
        return _build_motion(objects, row, place_on_arc(objects, row, predict_yielding(speed), curvature), reason)
    if objects.kind[row] == Kind.STATIC:
        return _build_motion(objects, row, place_on_arc(objects, row, predict_constant_speed(0.0), 0.0), reason)
    fastest = predict_acceleration(speed, top_speed)
    return _predict_between(objects, row, (predict_hesitation(speed), fastest), curvature, reason)


def _build_reason(objects: Objects, row: int, cause: Cause, distance_m: float | None = None) -> Reason:
    """Return the reason to mind an object."""
    return Reason(cause, (objects.ids[row],), (float(objects.x[row]), float(objects.y[row])), distance_m)


def _predict_between(
    objects: Objects, row: int, bounds: tuple[Float, Float], curvature: float, reason: Reason
) -> PredictedMotion:
    """Return the motion of an object that travels between two distances (T,) [m]: its box covers both."""
    least, most = bounds
    middle = place_on_arc(objects, row, (most + least) / 2, curvature)[:RELIABLE_ROWS]
    length = float(objects.length[row]) + (most - least)[:RELIABLE_ROWS]
    return PredictedMotion(middle, length, float(objects.width[row]), reason)


def _build_motion(objects: Objects, row: int, poses: Float, reason: Reason) -> PredictedMotion:
    """Return the motion of an object that stands at the end of these poses (T, 3)."""
    return PredictedMotion(poses, float(objects.length[row]), float(objects.width[row]), reason, stands_at_end=True)
