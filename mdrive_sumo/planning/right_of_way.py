"""Right of way by observation: objects on the own path, and conflicts with those that will cross it.

Only the observed state of others is known: they are predicted to keep their speed and their present turn.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from mdrive_sumo.contract import Objects, VehicleFacts
from mdrive_sumo.core import portable
from mdrive_sumo.core.compiled import twin
from mdrive_sumo.core.geometry import Bool, Float, Int, boxes_corners, wrap_angle
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.parameters import RIGHT_OF_WAY, RightOfWayParameters
from mdrive_sumo.planning.path_overlap import compute_footprints, compute_overlaps, find_cells
from mdrive_sumo.planning.reference_path import ReferencePath

Position: TypeAlias = tuple[float, float]
"""x, y [m] in the world frame. Observed objects carry no common ids, but all cars observe the same positions: where two
cars are equal in everything else, the one further west (then further south) goes first, and both know it."""


@dataclass(frozen=True, slots=True)
class EgoMotion:
    """The own car: position [m], speed [m/s], and the acceleration [m/s2] to its cruising speed [m/s]."""

    position: Position
    speed: float
    cruise_speed: float
    acceleration: float

    def compute_time_to(self, distance: float) -> float:
        """Return the time [s] that the car needs for that distance [m]."""
        cruise_speed = max(self.cruise_speed, self.speed, 0.1)
        ramp = (cruise_speed - self.speed) / self.acceleration
        ramp_m = (cruise_speed + self.speed) / 2 * ramp
        if distance >= ramp_m:
            return ramp + (distance - ramp_m) / cruise_speed
        return (math.sqrt(self.speed * self.speed + 2 * self.acceleration * distance) - self.speed) / self.acceleration


@dataclass(frozen=True, slots=True)
class PathPreview:
    """The own path ahead at stations (A,): distance [m], direction [rad], footprints (A, 4, 2) [m]."""

    distance: Float
    yaw: Float
    boxes: Float


@dataclass(frozen=True, slots=True)
class LeadObject:
    """An object on the path: the distance [m] until the own car touches it, and its speed along the path [m/s]."""

    gap_m: float
    speed: float
    id: str
    position: Position
    """Present position of the object."""


@dataclass(frozen=True, slots=True)
class CrossingConflict:
    """A road user whose predicted path crosses the own path."""

    id: str
    begin_m: float
    """Begin and end of the shared area on the own path [m from here]."""
    end_m: float
    """Behind it the own path is free again [m from here]."""
    arrives_s: float
    """When the other road user enters and leaves that area [s from now]."""
    leaves_s: float
    """When its rear has left the shared area [s from now]."""
    is_standing: bool
    """Whether it is slower than `RightOfWayParameters.moving_speed`."""
    bearing: float
    """Heading of the other road user relative to the own heading [rad]."""
    ego_turns: bool
    """Whether the own path turns before the shared area."""
    position: Position
    """Present position of the other road user."""


@twin
def preview_path(
    path: ReferencePath, s: float, vehicle: VehicleFacts, parameters: RightOfWayParameters = RIGHT_OF_WAY, /
) -> PathPreview:
    """Return the path ahead of a car at arc length s [m]."""
    distance = np.arange(0.0, parameters.look_ahead_m, parameters.stride_m)
    cells = find_cells(path, s + distance)
    boxes = compute_footprints(path, vehicle.length, vehicle.width + 2 * parameters.side_gap_m, cells)
    return PathPreview(distance, path.yaw[cells], boxes)


@twin
def find_lead_objects(
    ego: EgoMotion, preview: PathPreview, objects: Objects, parameters: RightOfWayParameters = RIGHT_OF_WAY, /
) -> list[LeadObject]:
    """Return the objects that are on the path now, without the cars of `find_followers_beside`."""
    met = _find_overlaps_now(preview, objects)
    rows = np.flatnonzero(met.any(0) & ~find_followers_beside(ego, preview, objects, parameters))
    first: Int = met[:, rows].argmax(0) + 1
    along = objects.speed[rows] * portable.cos(objects.yaw[rows] - preview.yaw[first])
    along = np.where(along > 0.0, along, 0.0)
    return [
        LeadObject(gap_m, speed, objects.ids[row], (float(objects.x[row]), float(objects.y[row])))
        for gap_m, speed, row in zip(preview.distance[first].tolist(), along.tolist(), rows.tolist(), strict=True)
    ]


@twin
def find_rows_on_path(
    ego: EgoMotion, preview: PathPreview, objects: Objects, parameters: RightOfWayParameters = RIGHT_OF_WAY, /
) -> Int:
    """Return the rows of the objects of `find_lead_objects`."""
    on_path = _find_overlaps_now(preview, objects).any(0)
    return np.flatnonzero(on_path & ~find_followers_beside(ego, preview, objects, parameters))


def _find_overlaps_now(preview: PathPreview, objects: Objects) -> Bool:
    """Return a mask (A - 1, N): which previewed stations which objects occupy now."""
    return compute_overlaps(preview.boxes[1:], _predict_boxes(objects, np.arange(len(objects.ids)), 0.0))


@twin
def find_followers_beside(
    ego: EgoMotion, preview: PathPreview, objects: Objects, parameters: RightOfWayParameters = RIGHT_OF_WAY, /
) -> Bool:
    """Return a mask (N,): objects in the own direction that are behind the own centre, or level and further east.

    These cars give way to the own car.
    """
    x, y = preview.boxes[0].mean(0)
    cos, sin = portable.cos_sin(preview.yaw[0])
    lead = (objects.x - x) * cos + (objects.y - y) * sin
    further_east = (objects.x > ego.position[0]) | ((objects.x == ego.position[0]) & (objects.y > ego.position[1]))
    behind = (lead < -parameters.level_m) | ((lead < parameters.level_m) & further_east)
    return find_same_direction(preview, objects, parameters) & behind


@twin
def find_same_direction(
    preview: PathPreview, objects: Objects, parameters: RightOfWayParameters = RIGHT_OF_WAY, /
) -> Bool:
    """Return a mask (N,): which objects head in about the own direction."""
    return portable.cos(objects.yaw - preview.yaw[0]) > portable.cos(parameters.same_direction_rad)


@twin
def find_crossing_conflicts(
    preview: PathPreview, objects: Objects, curvature: Float, parameters: RightOfWayParameters = RIGHT_OF_WAY, /
) -> list[CrossingConflict]:
    """Return the conflicts with nearby road users that are predicted on arcs of `curvature` (N,) [1/m]."""
    centre = preview.boxes[0].mean(0)[:, None]
    near = portable.hypot(*(centre - np.array((objects.x, objects.y)))) < parameters.look_ahead_m
    rows = np.flatnonzero(near & (objects.kind != Kind.STATIC))
    travelled = np.arange(0.0, parameters.look_ahead_m, parameters.stride_m)
    swept = _predict_boxes(objects, rows[:, None], travelled, curvature[rows, None])
    met = compute_overlaps(preview.boxes, swept.reshape(-1, 4, 2)).reshape(len(preview.distance), *swept.shape[:2])
    return [
        _build_conflict(preview, objects, row, met[:, k], parameters)
        for k, row in enumerate(rows.tolist())
        if met[:, k].any()
    ]


def _build_conflict(
    preview: PathPreview, objects: Objects, row: int, met: Bool, parameters: RightOfWayParameters
) -> CrossingConflict:
    """Return the conflict with one object; met: (A, K) which stations it overlaps after so many strides."""
    mine, theirs = np.flatnonzero(met.any(1)), np.flatnonzero(met.any(0))
    is_standing = float(objects.speed[row]) < parameters.moving_speed
    speed = parameters.moving_speed if is_standing else float(objects.speed[row])
    return CrossingConflict(
        id=objects.ids[row],
        begin_m=float(preview.distance[mine[0]]),
        end_m=float(preview.distance[mine[-1]]),
        arrives_s=float(theirs[0]) * parameters.stride_m / speed,
        leaves_s=float(theirs[-1] + 1) * parameters.stride_m / speed,
        is_standing=is_standing,
        bearing=wrap_angle(float(objects.yaw[row] - preview.yaw[0])),
        ego_turns=abs(float(preview.yaw[mine[0]] - preview.yaw[0])) > parameters.side_angles_rad[0],
        position=(float(objects.x[row]), float(objects.y[row])),
    )


def must_yield(
    ego: EgoMotion,
    conflict: CrossingConflict,
    yielded_before: bool,
    is_impatient: bool,
    parameters: RightOfWayParameters = RIGHT_OF_WAY,
) -> bool:
    """Return whether the own car yields: the other road user arrives earlier, or wins a tie (two standing cars tie).

    A car that `yielded_before` keeps yielding while the other one is not clearly later; an impatient car wins ties.
    """
    arrives_s, leaves_s = ego.compute_time_to(conflict.begin_m), ego.compute_time_to(conflict.end_m)
    gap_s = parameters.conflict_gap_s
    if arrives_s > conflict.leaves_s + gap_s or leaves_s + gap_s < conflict.arrives_s:
        return False
    lead_s = conflict.arrives_s - arrives_s
    if (conflict.is_standing and ego.speed < parameters.moving_speed) or abs(lead_s) < parameters.tie_s:
        return not is_impatient and _loses_tie(ego, conflict, parameters)
    return lead_s < (parameters.hysteresis_s if yielded_before and not is_impatient else 0.0)


def _loses_tie(ego: EgoMotion, conflict: CrossingConflict, parameters: RightOfWayParameters) -> bool:
    """Return whether the own car loses a tie: right before left; straight before turning; then the one further west."""
    low, high = parameters.side_angles_rad
    if low < abs(conflict.bearing) < high:
        return conflict.bearing > 0  # it crosses from right to left
    return conflict.ego_turns or conflict.position < ego.position


def _predict_boxes(objects: Objects, rows: Int, travelled: Float | float, curvature: Float | float = 0.0) -> Float:
    """Return the corners (..., 4, 2) [m] of objects after `travelled` [m] on arcs; all arguments broadcast."""
    turned = np.clip(curvature * travelled, -RIGHT_OF_WAY.max_turn_rad, RIGHT_OF_WAY.max_turn_rad)
    # A chord of length travelled: exact for small turns, and large turns are guesses anyway.
    cos, sin = portable.cos_sin(objects.yaw[rows] + turned / 2)
    return boxes_corners(
        objects.x[rows] + travelled * cos,
        objects.y[rows] + travelled * sin,
        objects.yaw[rows] + turned,
        objects.length[rows],
        objects.width[rows],
    )


class CurvatureEstimator:
    """Estimates how sharply objects turn from their change of heading: observations contain no yaw rates."""

    def __init__(self, parameters: RightOfWayParameters = RIGHT_OF_WAY) -> None:
        self._yaw_by_id: dict[str, float] = {}
        self._parameters = parameters

    def update(self, objects: Objects, elapsed_s: float) -> Float:
        """Return the curvature (N,) [1/m] of the objects' paths since the last call; 0 for new and standing ones."""
        curvature, self._yaw_by_id = estimate_curvatures(objects, self._yaw_by_id, elapsed_s, self._parameters)
        return curvature


@twin
def estimate_curvatures(
    objects: Objects, yaw_by_id: Mapping[str, float], elapsed_s: float, parameters: RightOfWayParameters, /
) -> tuple[Float, dict[str, float]]:
    """Return `CurvatureEstimator.update`, and the headings of all objects; yaw_by_id: headings `elapsed_s` ago."""
    yaws = objects.yaw.tolist()
    turns = [wrap_angle(yaw - yaw_by_id.get(name, yaw)) for name, yaw in zip(objects.ids, yaws, strict=True)]
    travelled = np.maximum(np.abs(objects.speed), 2 * parameters.moving_speed) * elapsed_s
    curvature = np.clip(np.array(turns) / travelled, -parameters.max_curvature, parameters.max_curvature)
    return curvature, dict(zip(objects.ids, yaws, strict=True))


class YieldingPolicy:
    """Decides which road users go first, with hysteresis and limited patience."""

    def __init__(self, seed: int, parameters: RightOfWayParameters = RIGHT_OF_WAY) -> None:
        self._parameters = parameters
        self._yielded_to: frozenset[str] = frozenset()
        self._waited_s = 0.0
        self._patience_s = float(np.random.default_rng(seed).uniform(*parameters.patience_s))

    def select_first(self, ego: EgoMotion, conflicts: Sequence[CrossingConflict], elapsed_s: float) -> frozenset[str]:
        """Return the ids of the road users to which the own car yields; elapsed_s: time since the last call [s]."""
        is_impatient = self._waited_s > self._patience_s
        self._yielded_to = frozenset(
            conflict.id
            for conflict in conflicts
            if must_yield(ego, conflict, conflict.id in self._yielded_to, is_impatient, self._parameters)
        )
        if is_impatient or (self._yielded_to and ego.speed < self._parameters.moving_speed):
            self._waited_s += elapsed_s
        if self._waited_s > self._patience_s + self._parameters.impatience_s:
            self._waited_s = 0.0
        return self._yielded_to
