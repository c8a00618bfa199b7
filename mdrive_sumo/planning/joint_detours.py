"""Detours around all standing objects on the paths of the CAVs, planned jointly before any CAV moves."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mdrive_sumo.contract import Briefing, Objects, Privileged
from mdrive_sumo.core.geometry import Bool, Float, boxes_corners, build_polyline
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.detour import find_detour, find_obstructing_boxes
from mdrive_sumo.planning.parameters import JOINT_PLANNING, JointPlanningParameters
from mdrive_sumo.planning.planning_scale import PROTOCOL_SCALE, PlanningScale
from mdrive_sumo.planning.reference_path import ReferencePath, build_path


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
    found: dict[str, tuple[ReferencePath, Briefing]] = {}
    for ego, route, state, room in zip(known.ego_ids, known.routes, known.states, known.rooms, strict=True):
        path = build_path(route, briefing.vehicle.rear_to_centre, state.yaw, scale.path)
        line = build_polyline(route)
        of_route = {"route_xy": route, "route_yaw": line.yaws_at(line.s), "route_s": line.s, "route_room": room}
        found[ego] = path, replace(briefing, ego_id=ego, **of_route)
    return found


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
