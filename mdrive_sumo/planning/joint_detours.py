"""Ways around all that stands on the paths of the CAVs, planned before anybody moves."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from mdrive_sumo.contract import Briefing, Objects, Privileged
from mdrive_sumo.core.geometry import Bool, Float, boxes_corners, build_polyline
from mdrive_sumo.core.state import Kind
from mdrive_sumo.planning.detour import around, in_the_way
from mdrive_sumo.planning.path import Path, make_path

STANDING_SPEED = 0.1
STEP_M = 10.0
"""Between the places from which the rest of a path is looked at."""
BEHIND_M = 1.0
"""What the car is beside already is not looked at again."""


def bypassing(known: Privileged, me: Briefing) -> Mapping[str, Path]:
    """The path of every living CAV, led around what stands on it wherever there is room; the same for whoever asks.

    Every CAV is taken to be a car like mine.
    """
    boxes = _corners(known.objects)[standing(known.objects)]
    return {ego: _bypass(path, boxes, view) for ego, (path, view) in _views(known, me).items()}


def undecided(known: Privileged, me: Briefing) -> bool:
    """Whether a vehicle that stands now is on anybody's path: it is parked, or it is about to leave."""
    objects = known.objects
    boxes = _corners(objects)[standing(objects) & (objects.kind == Kind.VEHICLE)]
    return bool(len(boxes)) and any(_on_path(path, boxes, me) for path, _ in _views(known, me).values())


def standing(objects: Objects) -> Bool:
    """(N,) what stands and is neither on foot nor on a cycle."""
    return np.isin(objects.kind, (Kind.STATIC, Kind.VEHICLE)) & (np.abs(objects.speed) < STANDING_SPEED)


def _views(known: Privileged, me: Briefing) -> dict[str, tuple[Path, Briefing]]:
    """The plain path of each CAV, and the briefing that it would have."""
    found: dict[str, tuple[Path, Briefing]] = {}
    for ego, route, state, room in zip(known.ego_ids, known.routes, known.states, known.rooms, strict=True):
        path = make_path(route, me.vehicle.rear_to_centre, state.yaw)
        line = build_polyline(route)
        yaws = line.yaws_at(line.s)
        found[ego] = path, replace(me, ego_id=ego, route_xy=route, route_yaw=yaws, route_s=line.s, route_room=room)
    return found


def _on_path(path: Path, boxes: Float, me: Briefing) -> bool:
    return any(in_the_way(path, s, boxes, me.vehicle).any() for s in np.arange(0.0, path.goal_s, STEP_M).tolist())


def _bypass(path: Path, boxes: Float, me: Briefing) -> Path:
    """The path around all boxes, corners (K, 4, 2) [m], that it can be led around, from the nearest on."""
    s = 0.0
    while len(boxes) and s < path.goal_s:
        detour = around(path, s, 0.0, boxes, me)
        path = path if detour is None else detour.path
        s += STEP_M
    return path


def _corners(objects: Objects) -> Float:
    return boxes_corners(objects.x, objects.y, objects.yaw, objects.length, objects.width)
