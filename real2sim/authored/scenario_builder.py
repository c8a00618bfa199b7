"""Authored scenes on their networks become scenarios: waypoints matched to lanes, starts moved apart, actors placed."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap, load
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.scenario.model import Pose
from mdrive_sumo.scenario.scenario import Ego, Scenario, first_problem
from real2sim.authored.actor_placement import never_set_off, placed, starts_in_contact
from real2sim.authored.start_separation import Legs, moved, moved_apart
from real2sim.carla.conversion_report import LeftOut, OffLane, Point, Shift
from real2sim.match.dense_route import route_of, start_pose
from real2sim.match.waypoint_matcher import REACH_M, Match, match_waypoints
from real2sim.scene import CavRoute, Scene

OFF_LANE_M = 0.5


@dataclass(frozen=True, slots=True)
class Authored:
    """A scenario, and what its conversion has to own up to."""

    scenario: Scenario
    waypoints: int
    shifts: tuple[Shift, ...]
    left_out: tuple[LeftOut, ...]
    off_lane: tuple[OffLane, ...]


@dataclass(frozen=True, slots=True)
class _Matched:
    scene: str
    route: CavRoute
    xy: Float
    """Waypoints (N, 2) [m] in the network's frame."""
    match: Match


def build_authored(scene: Scene, network: Path) -> Authored:
    """Puts a scene on the network in a folder; raises InputError.

    The network's frame is the map's, moved by its netOffset. Actors are where their files say; CAVs are on their lanes.
    """
    roads, offset = load(network), np.array(read_network_file(network).offset)
    cavs = [_matched(scene, route, roads, offset) for route in scene.routes]
    shifts = _shifts(scene, roads, [cav.match for cav in cavs])
    egos = tuple(_ego(cav, roads, shift) for cav, shift in zip(cavs, shifts, strict=True))
    actors, notes = placed(scene.actors, roads, (float(offset[0]), float(offset[1])))
    notes = (*scene.notes, *notes, *starts_in_contact(egos, actors, roads), *never_set_off(egos, actors))
    try:
        scenario = Scenario(
            id=scene.id,
            bucket=scene.bucket,
            category=scene.category,
            network=network.name,
            description=scene.description,
            egos=egos,
            actors=actors,
            weather=scene.weather,
            notes=notes,
        )
    except ValidationError as error:
        raise InputError(f"{scene.id}: {first_problem(error)}") from None
    return Authored(
        scenario=scenario,
        waypoints=sum(len(route.waypoints) for route in scene.routes),
        shifts=tuple(Shift(scene.id, cav.route.id, s) for cav, s in zip(cavs, shifts, strict=True) if s),
        left_out=tuple(out for cav in cavs for out in _left_out(cav, roads)),
        off_lane=tuple(off for cav in cavs for off in _off_lane(cav, roads)),
    )


def _matched(scene: Scene, route: CavRoute, roads: RoadMap, offset: Float) -> _Matched:
    xy = route.waypoints + offset
    try:
        return _Matched(scene.id, route, xy, match_waypoints(roads, xy))
    except InputError as error:
        raise InputError(f"{scene.id}: CAV {route.id}: {error}") from None


def _shifts(scene: Scene, roads: RoadMap, matches: Sequence[Match]) -> tuple[float, ...]:
    try:
        return moved_apart(roads, [match.legs for match in matches])
    except InputError as error:
        raise InputError(f"{scene.id}: {error}") from None


def _ego(cav: _Matched, roads: RoadMap, shift: float) -> Ego:
    legs: Legs = moved(roads, cav.match.legs, shift)
    dense = route_of(roads, legs)
    x, y, yaw = start_pose(roads, legs)
    xy, yaws = dense.xy.round(3), dense.yaw.round(4)  # as the file is written: the report counts what is in it
    points = zip(xy[:, 0].tolist(), xy[:, 1].tolist(), yaws.tolist(), strict=True)
    return Ego(id=cav.route.id, start=Pose(x=x, y=y, yaw=yaw), lanes=dense.lanes, route=tuple(points))


def _off_lane(cav: _Matched, roads: RoadMap) -> Iterator[OffLane]:
    for foot in cav.match.feet:
        if abs(foot.d) > OFF_LANE_M:
            nearest, distance = _nearest(cav, foot.waypoint, roads)
            yield OffLane(_point(cav, foot.waypoint), foot.lane, round(abs(foot.d), 3), nearest, round(distance, 3))


def _left_out(cav: _Matched, roads: RoadMap) -> Iterator[LeftOut]:
    for i in cav.match.left_out:
        nearest, distance = _nearest(cav, i, roads)
        reason = f"no lane within {REACH_M:g} m" if distance > REACH_M else "no way to it and on from it (behind?)"
        yield LeftOut(_point(cav, i), nearest, round(distance, 3), reason)


def _nearest(cav: _Matched, waypoint: int, roads: RoadMap) -> tuple[str, float]:
    found = roads.nearest(cav.xy[waypoint : waypoint + 1])
    return roads.driving[found.lane[0]].id, float(found.distance[0])


def _point(cav: _Matched, waypoint: int) -> Point:
    x, y = cav.route.waypoints[waypoint].round(3).tolist()
    return Point(cav.scene, cav.route.id, waypoint, x, y)
