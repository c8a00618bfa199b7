"""The joint plan of all CAVs before they move: paths, overlaps and the order in which they plan.

Every CAV computes the same. On roads whose limits count a plan takes seconds, so those that share a process share it.
"""

import hashlib
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache

import numpy as np

from mdrive_sumo.contract import Briefing, Objects, Privileged
from mdrive_sumo.core.geometry import Bool, Float, boxes_corners, build_polyline
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.detour import find_detour, find_obstructing_boxes
from mdrive_sumo.planning.fleet_paths import FleetPaths
from mdrive_sumo.planning.parameters import JOINT_PLANNING, JointPlanningParameters
from mdrive_sumo.planning.planning_order import find_planning_order
from mdrive_sumo.planning.planning_scale import PROTOCOL_SCALE, PlanningScale
from mdrive_sumo.planning.reference_path import (
    SPACING_M,
    PathState,
    ReferencePath,
    build_path,
    interpolate_legal_speeds,
)
from mdrive_sumo.planning.speed_lattice import FINE, LatticeParameters, choose_lattice
from mdrive_sumo.planning.speed_profile import SpeedProfileProblem, build_free_road_problem

SpeedsOfPath = Callable[[ReferencePath, Float], Float]
"""Highest comfortable speed (M,) [m/s] at the points of a path with speed limits (M,) [m/s]."""


@dataclass(frozen=True, slots=True)
class RoadHorizon:
    """How long a plan may take on roads whose limits count: independent of the time limit, which follows from it."""

    factor: float = 2.0
    """Times the time on a free road, ..."""
    extra_s: float = 40.0
    """... and so much more: a red light, or a queue."""


ROAD_HORIZON = RoadHorizon()
OVERLAP_STRIDE = 2
"""Overlaps of paths are known every 0.5 m: routes are several times longer than those of the protocol."""


@dataclass(frozen=True)
class _JointProblem:
    """Everything that a joint plan depends on; equal ones have equal content."""

    content: str
    known: Privileged = field(compare=False)
    briefing: Briefing = field(compare=False)
    scale: PlanningScale = field(compare=False)
    compute_speeds: SpeedsOfPath = field(compare=False)


def plan_on_roads(
    known: Privileged, briefing: Briefing, scale: PlanningScale, compute_speeds: SpeedsOfPath
) -> tuple[FleetPaths, tuple[str, ...]]:
    """Return paths and order of planning of CAVs that may start at speed; `compute_speeds` depends on `scale` only."""
    digest = hashlib.blake2b(digest_size=16)
    objects = (getattr(known.objects, column.name) for column in fields(Objects))
    columns = [column for column in objects if isinstance(column, np.ndarray)]
    for array in (*known.routes, *known.rooms, *known.speed_limits, *columns):
        digest.update(np.ascontiguousarray(array).tobytes() + b"|")
    content = f"{digest.hexdigest()} {known.ego_ids} {known.states} {briefing.vehicle} {scale.top_speed!r}"
    return _plan_once(_JointProblem(content, known, briefing, scale, compute_speeds))


@lru_cache(maxsize=1)
def _plan_once(problem: _JointProblem) -> tuple[FleetPaths, tuple[str, ...]]:
    """Return the plan; computed once for all CAVs of a process that ask in the same tick."""
    known, briefing, scale = problem.known, problem.briefing, problem.scale
    size = briefing.vehicle.length, briefing.vehicle.width
    fleet = FleetPaths(
        plan_joint_detours(known, briefing, scale), size, stride=OVERLAP_STRIDE, margin=scale.plan_margin
    )
    free = {ego: _build_problem(problem, ego, path) for ego, path in fleet.path_by_ego.items()}
    return fleet, find_planning_order(fleet, free)


def _build_problem(problem: _JointProblem, ego: str, path: ReferencePath) -> SpeedProfileProblem:
    """Return the problem of one CAV on a free road, with coarse steps: only the order counts."""
    row = problem.known.ego_ids.index(ego)
    state, lattice = problem.known.states[row], choose_lattice(problem.scale.top_speed, LatticeParameters(10.0, 0.0))
    route_s = np.linspace(0.0, path.goal_s, len(problem.known.routes[row]))
    speeds = problem.compute_speeds(path, interpolate_legal_speeds(path, route_s, problem.known.speed_limits[row]))
    start = PathState(path.project(state.x, state.y, 0.0), max(state.speed, 0.0))
    return build_free_road_problem(path, speeds, start, 0.0, find_road_horizon(speeds, start.s), lattice)


def find_road_horizon(speeds: Float, s: float, parameters: RoadHorizon = ROAD_HORIZON) -> float:
    """Return how long a plan from arc length s [m] may take [s]; speeds: (M,) [m/s] at the points of a path."""
    rest = speeds[int(s / SPACING_M) :]
    free_s = float(np.sum(SPACING_M / np.maximum(rest, 1.0)))
    return parameters.factor * free_s + parameters.extra_s


def find_common_scale(briefing: Briefing, chosen: float | None, default: float, known: Privileged) -> PlanningScale:
    """Return the scale of all CAVs together; chosen, default: as `find_cruise_speed` has them."""
    highest = max(float(limits.max()) for limits in known.speed_limits) if known.speed_limits else math.inf
    cruise_speed = default if chosen is None and briefing.desired_speed is not None else (chosen or highest)
    return PlanningScale(cruise_speed if cruise_speed <= FINE.top_speed else min(cruise_speed, highest))


def plan_joint_detours(
    known: Privileged, briefing: Briefing, scale: PlanningScale = PROTOCOL_SCALE
) -> Mapping[str, ReferencePath]:
    """Return the path of every living CAV by id, led around standing objects wherever there is room.

    The result is the same for every CAV that asks. All CAVs are assumed to have the vehicle of `briefing`.
    """
    boxes = _compute_corners(known.objects)[find_standing_objects(known.objects)]
    step_m = JOINT_PLANNING.detour_step_m
    plain = _build_plain_paths(known, briefing, scale)
    return {ego: _avoid_boxes(path, boxes, of_ego, step_m) for ego, (path, of_ego) in plain.items()}


def has_undecided_vehicle(known: Privileged, briefing: Briefing, scale: PlanningScale = PROTOCOL_SCALE) -> bool:
    """Return whether a vehicle that stands now obstructs the path of a CAV: it is parked, or it is about to leave."""
    objects = known.objects
    standing = find_standing_objects(objects) & (objects.kind == Kind.VEHICLE)
    boxes = _compute_corners(objects)[standing]
    if not len(boxes):
        return False
    return any(
        find_obstructing_boxes(path, s, boxes, briefing.vehicle).any()
        for path, _ in _build_plain_paths(known, briefing, scale).values()
        for s in np.arange(0.0, path.goal_s, JOINT_PLANNING.detour_step_m).tolist()
    )


def find_standing_objects(objects: Objects, parameters: JointPlanningParameters = JOINT_PLANNING) -> Bool:
    """Return a mask (N,): which static objects and vehicles stand."""
    is_box = np.isin(objects.kind, (Kind.STATIC, Kind.VEHICLE))
    return is_box & (np.abs(objects.speed) < parameters.standing_speed)


def _build_plain_paths(
    known: Privileged, briefing: Briefing, scale: PlanningScale
) -> dict[str, tuple[ReferencePath, Briefing]]:
    """Return by CAV id its path without detours and the briefing that it would have."""
    plain: dict[str, tuple[ReferencePath, Briefing]] = {}
    for ego, route, state, room in zip(known.ego_ids, known.routes, known.states, known.rooms, strict=True):
        path = build_path(route, briefing.vehicle.rear_to_centre, state.yaw, scale.path)
        line = build_polyline(route)
        of_route = {"route_xy": route, "route_yaw": line.yaws_at(line.s), "route_s": line.s, "route_room": room}
        plain[ego] = path, replace(briefing, ego_id=ego, **of_route)
    return plain


def _avoid_boxes(path: ReferencePath, boxes: Float, briefing: Briefing, step_m: float) -> ReferencePath:
    """Return the path around all boxes (K, 4, 2) [m] that it can avoid, beginning with the nearest."""
    s = 0.0
    while len(boxes) and s < path.goal_s:
        detour = find_detour(path, s, 0.0, boxes, briefing)
        path = path if detour is None else detour.path
        s += step_m
    return path


def _compute_corners(objects: Objects) -> Float:
    """Return the corners (N, 4, 2) [m] of the objects' boxes."""
    return boxes_corners(objects.x, objects.y, objects.yaw, objects.length, objects.width)
