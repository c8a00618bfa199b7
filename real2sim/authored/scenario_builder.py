"""Build scenarios from authored scenes: match waypoints to lanes, separate starts, place actors."""

import heapq
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, box_corners, boxes_overlap
from mdrive_sumo.roads import RoadMap, load_road_map
from mdrive_sumo.roads.network_file import read_network_file
from mdrive_sumo.scenario.scenario import Ego, Scenario, describe_first_error
from mdrive_sumo.scenario.scenario_part import Pose
from real2sim.authored.actor_placement import note_start_contacts, note_unreachable_triggers, place_actors
from real2sim.carla.conversion_report import DroppedWaypoint, OffLaneWaypoint, ReportedWaypoint, StartShift
from real2sim.match.waypoint_matcher import (
    CANDIDATE_RANGE_M,
    RouteLeg,
    WaypointMatch,
    build_dense_route,
    compute_start_pose,
    match_waypoints,
)
from real2sim.source_scene import CavRoute, SourceScene

OFF_LANE_M = 0.5
"""[m] Waypoints further than this from their lane are reported."""
CAR_LENGTH_M = 4.90
CAR_WIDTH_M = 2.00
"""[m] Length and width of a CAV: authored files have none."""
GAP_M = 0.02
"""[m] Kept between boxes, so that rounding poses to 1 mm cannot bring them into contact."""
SHIFT_STEP_M = 0.1
"""[m] Starts move in steps of this length."""
MAX_SHIFT_M = 20.0
"""[m] No start is moved further; chosen: four lengths of a car."""

RouteLegs = tuple[RouteLeg, ...]


@dataclass(frozen=True, slots=True)
class AuthoredScenario:
    """A scenario, and what its conversion has to report."""

    scenario: Scenario
    waypoints: int
    shifts: tuple[StartShift, ...]
    left_out: tuple[DroppedWaypoint, ...]
    off_lane: tuple[OffLaneWaypoint, ...]


@dataclass(frozen=True, slots=True)
class _MatchedCav:
    scene: str
    route: CavRoute
    xy: Float
    """Waypoints (N, 2) [m] in the network's frame."""
    match: WaypointMatch


def build_scenario(scene: SourceScene, network: Path) -> AuthoredScenario:
    """Build the scenario of a scene on the network in a folder; raise InputError.

    The network's frame is that of the map, shifted by its netOffset. Actors keep their authored positions; CAVs are
    moved onto their lanes.
    """
    roads, offset = load_road_map(network), np.array(read_network_file(network).offset)
    cavs = [_match_route(scene, route, roads, offset) for route in scene.routes]
    shifts = _compute_shifts(scene, roads, [cav.match for cav in cavs])
    egos = tuple(_build_ego(cav, roads, shift) for cav, shift in zip(cavs, shifts, strict=True))
    actors, notes = place_actors(scene.actors, roads, (float(offset[0]), float(offset[1])))
    notes = (*scene.notes, *notes, *note_start_contacts(egos, actors, roads), *note_unreachable_triggers(egos, actors))
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
        raise InputError(f"{scene.id}: {describe_first_error(error)}") from None
    return AuthoredScenario(
        scenario=scenario,
        waypoints=sum(len(route.waypoints) for route in scene.routes),
        shifts=tuple(StartShift(scene.id, cav.route.id, s) for cav, s in zip(cavs, shifts, strict=True) if s),
        left_out=tuple(out for cav in cavs for out in _find_dropped(cav, roads)),
        off_lane=tuple(off for cav in cavs for off in _find_off_lane(cav, roads)),
    )


def _match_route(scene: SourceScene, route: CavRoute, roads: RoadMap, offset: Float) -> _MatchedCav:
    xy = route.waypoints + offset
    try:
        return _MatchedCav(scene.id, route, xy, match_waypoints(roads, xy))
    except InputError as error:
        raise InputError(f"{scene.id}: CAV {route.id}: {error}") from None


def _compute_shifts(scene: SourceScene, roads: RoadMap, matches: Sequence[WaypointMatch]) -> tuple[float, ...]:
    try:
        return separate_starts(roads, [match.legs for match in matches])
    except InputError as error:
        raise InputError(f"{scene.id}: {error}") from None


def _build_ego(cav: _MatchedCav, roads: RoadMap, shift: float) -> Ego:
    legs: RouteLegs = advance_start(roads, cav.match.legs, shift)
    dense = build_dense_route(roads, legs)
    x, y, yaw = compute_start_pose(roads, legs)
    xy, yaws = (
        dense.xy.round(3),
        dense.yaw.round(4),
    )  # rounded as in the file, so that the report counts the same points
    points = zip(xy[:, 0].tolist(), xy[:, 1].tolist(), yaws.tolist(), strict=True)
    return Ego(id=cav.route.id, start=Pose(x=x, y=y, yaw=yaw), lanes=dense.lanes, route=tuple(points))


def _find_off_lane(cav: _MatchedCav, roads: RoadMap) -> Iterator[OffLaneWaypoint]:
    for foot in cav.match.projections:
        if abs(foot.offset) > OFF_LANE_M:
            nearest, distance = _find_nearest_lane(cav, foot.waypoint, roads)
            yield OffLaneWaypoint(
                _build_waypoint(cav, foot.waypoint), foot.lane, round(abs(foot.offset), 3), nearest, round(distance, 3)
            )


def _find_dropped(cav: _MatchedCav, roads: RoadMap) -> Iterator[DroppedWaypoint]:
    for i in cav.match.dropped:
        nearest, distance = _find_nearest_lane(cav, i, roads)
        reason = (
            f"no lane within {CANDIDATE_RANGE_M:g} m"
            if distance > CANDIDATE_RANGE_M
            else "no way to it and on from it (behind?)"
        )
        yield DroppedWaypoint(_build_waypoint(cav, i), nearest, round(distance, 3), reason)


def _find_nearest_lane(cav: _MatchedCav, waypoint: int, roads: RoadMap) -> tuple[str, float]:
    nearest = roads.find_nearest_lanes(cav.xy[waypoint : waypoint + 1])
    return roads.driving[nearest.lane[0]].id, float(nearest.distance[0])


def _build_waypoint(cav: _MatchedCav, waypoint: int) -> ReportedWaypoint:
    x, y = cav.route.waypoints[waypoint].round(3).tolist()
    return ReportedWaypoint(cav.scene, cav.route.id, waypoint, x, y)


def separate_starts(roads: RoadMap, routes: Sequence[RouteLegs]) -> tuple[float, ...]:
    """Return how far each start moves forward [m], in steps of `SHIFT_STEP_M`, with the smallest sum; raise InputError.

    Uniform-cost search over the shifts: of two overlapping boxes, one moves on until it is clear of the other. Sharing
    the distance between both is never shorter, because a separating axis is reached soonest by the box that is faster
    along it.
    """

    @cache
    def box(cav: int, steps: int) -> Float:
        pose = compute_start_pose(roads, advance_start(roads, routes[cav], steps * SHIFT_STEP_M))
        return box_corners(*pose, CAR_LENGTH_M + GAP_M, CAR_WIDTH_M + GAP_M)

    @cache
    def limit(cav: int) -> int:  # at least 2 m of the route are left
        length = float(np.hypot(*np.diff(build_dense_route(roads, routes[cav]).xy, axis=0).T).sum())
        return max(int((min(length - 2.0, MAX_SHIFT_M)) / SHIFT_STEP_M), 0)

    queue: list[tuple[int, tuple[int, ...]]] = [(0, (0,) * len(routes))]
    seen: set[tuple[int, ...]] = set()
    while queue:
        total, steps = heapq.heappop(queue)
        if steps in seen:
            continue
        seen.add(steps)
        boxes = [box(cav, count) for cav, count in enumerate(steps)]
        pairs = combinations(range(len(boxes)), 2)
        pair = next(((i, j) for i, j in pairs if boxes_overlap(boxes[i], boxes[j])), None)
        if pair is None:
            return tuple(round(n * SHIFT_STEP_M, 3) for n in steps)
        for mover, other in (pair, pair[::-1]):
            further = range(steps[mover] + 1, limit(mover) + 1)
            clear = (n for n in further if not boxes_overlap(box(mover, n), box(other, steps[other])))
            if (n := next(clear, None)) is not None:
                heapq.heappush(queue, (total + n - steps[mover], (*steps[:mover], n, *steps[mover + 1 :])))
    raise InputError(f"expected starts that can be moved apart by up to {MAX_SHIFT_M:g} m, found none")


def advance_start(roads: RoadMap, legs: RouteLegs, distance: float) -> RouteLegs:
    """Return the legs without their first `distance` metres; raise InputError if they are shorter."""
    if not legs:
        raise InputError("expected a route long enough to move its start, found its end")
    first, rest = legs[0], legs[1:]
    lane = roads.lanes[first.lanes[0]]
    alone = len(first.lanes) == 1
    room = (first.goal_s if alone else lane.centre.length) - first.start_s
    if distance < room:
        return (replace(first, start_s=first.start_s + distance), *rest)
    if alone:
        return advance_start(roads, rest, distance - room)
    entry = roads.lanes[first.lanes[1]]
    begin = 0.0 if entry.id in lane.successors else entry.centre.project(*lane.centre.at(lane.centre.length))[0]
    return advance_start(roads, (RouteLeg(first.lanes[1:], begin, first.goal_s), *rest), distance - room)
