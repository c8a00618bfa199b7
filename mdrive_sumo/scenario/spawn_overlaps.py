"""Overlaps of boxes at the start, in addition to the checks before every drive.

Covers CAVs, background vehicles present at the start, and standing actors.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations

import shapely

from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.checks import TOUCHING_M2
from mdrive_sumo.scenario.scenario import Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, ReplayMotion, StandingMotion, StartMotion
from mdrive_sumo.scenario.start_boxes import build_box, build_user_box, compute_first_pose, find_departure_pose

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
        yield SpawnBox("CAV", ego.id, build_user_box(ego))
    for vehicle in scenario.background.vehicles:
        pose = find_departure_pose(vehicle, roads, scenario.background.mode) if vehicle.depart_s == 0.0 else None
        if pose is not None:
            yield SpawnBox("vehicle", vehicle.id, build_box(pose, vehicle.length, vehicle.width))
    for actor in scenario.actors:
        if _is_standing(actor):
            pose = compute_first_pose(actor, roads)
            yield SpawnBox("actor", actor.id, build_box(pose, actor.length - SLACK_M, actor.width - SLACK_M))


def _is_standing(actor: Actor) -> bool:
    """Return whether the actor stands: props, parked cars, and actors that wait for a trigger."""
    waits = actor.trigger is not None and isinstance(actor.action, StartMotion | None)
    return isinstance(actor.motion, StandingMotion) or (waits and not isinstance(actor.motion, ReplayMotion))
