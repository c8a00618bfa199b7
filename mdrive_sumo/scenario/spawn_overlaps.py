"""Overlaps of boxes at the start, in addition to the checks before every drive.

Covers CAVs, background vehicles present at the start, and standing actors.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import box_corners
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.scenario.background import Background, BackgroundVehicle
from mdrive_sumo.scenario.checks import CAR, TOUCHING_M2, compute_first_pose
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion, StandingMotion, StartMotion

SLACK_M = 0.1
"""[m] Standing actors may overlap by this: a log has no better positions and sizes, and none of them moves."""


@dataclass(frozen=True, slots=True)
class SpawnBox:
    """A box that is present in frame 0."""

    kind: str
    """CAV, vehicle or actor."""
    id: str
    box: shapely.Polygon


def find_spawn_overlaps(scenario: Scenario, roads: RoadMap) -> Iterator[str]:
    """Return which boxes overlap at the start, one sentence each."""
    spawns = tuple(_spawn_boxes(scenario, roads))
    for one, other in combinations(spawns, 2):
        if (one.kind, other.kind) == ("CAV", "actor"):
            continue  # `check_scenario` has looked
        area = float(shapely.intersection(one.box, other.box).area) if one.box.intersects(other.box) else 0.0
        if area > TOUCHING_M2:
            yield f"{one.kind} {one.id} and {other.kind} {other.id} start inside each other ({area:.2f} m2 overlap)"
    for spawn in spawns:
        if spawn.kind == "CAV" and any(spawn.box.intersects(building) for building in roads.building_shapes):
            yield f"CAV {spawn.id} starts inside a building"


def _spawn_boxes(scenario: Scenario, roads: RoadMap) -> Iterator[SpawnBox]:
    for ego in scenario.egos:
        yield _make_box("CAV", ego.id, ego.start, (CAR.length, CAR.width))
    for vehicle in scenario.background.vehicles:
        if (pose := _departure_pose(vehicle, scenario.background, roads)) is not None:
            yield _make_box("vehicle", vehicle.id, pose, (vehicle.length, vehicle.width))
    for actor in scenario.actors:
        if _is_standing(actor):
            yield _make_box(
                "actor", actor.id, compute_first_pose(actor, roads), (actor.length - SLACK_M, actor.width - SLACK_M)
            )


def _make_box(kind: str, name: str, pose: Pose, size: tuple[float, float]) -> SpawnBox:
    return SpawnBox(kind, name, shapely.Polygon(box_corners(pose.x, pose.y, pose.yaw, *size)))


def _is_standing(actor: Actor) -> bool:
    """Return whether the actor stands: props, parked cars, and actors that wait for a trigger."""
    waits = actor.trigger is not None and isinstance(actor.action, StartMotion | None)
    return isinstance(actor.motion, StandingMotion) or (waits and not isinstance(actor.motion, ReplayMotion))


def _departure_pose(vehicle: BackgroundVehicle, background: Background, roads: RoadMap) -> Pose | None:
    """Return where a vehicle is in frame 0: on its log, else where it departs on its lane; None if it comes later."""
    if vehicle.depart_s > 0.0:
        return None
    if vehicle.log and background.mode != "reactive":
        _, x, y, yaw = vehicle.log[0]
        return Pose(x=x, y=y, yaw=yaw)
    lane = roads.lanes.get(f"{vehicle.edges[0]}_{vehicle.depart_lane}")
    front = vehicle.depart_pos_m + (vehicle.schedule.progress[0][1] if vehicle.schedule else 0.0)
    if lane is None or front > lane.centre.length:
        return None
    pose = _pose_behind_front(lane, front, vehicle.length)
    return pose if vehicle.parked is None else _move_left(pose, vehicle.parked.offset_m)


def _pose_behind_front(lane: Lane, front: float, length: float) -> Pose:
    (x, y), yaw = lane.centre.at(front), lane.centre.yaw_at(front)
    return Pose(x=x - portable.cos(yaw) * length / 2, y=y - portable.sin(yaw) * length / 2, yaw=yaw)


def _move_left(pose: Pose, offset_m: float) -> Pose:
    cos, sin = portable.cos_sin(pose.yaw)
    return Pose(x=pose.x - sin * offset_m, y=pose.y + cos * offset_m, yaw=pose.yaw)
