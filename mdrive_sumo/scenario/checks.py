"""Checks that a scenario fits its network, before the simulation, so that a bad file gets one clear error."""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.scenario.scripted_actor import Actor, LaneMotion, PathMotion, PositionTrigger, ReplayMotion
from mdrive_sumo.scenario.start_boxes import CAR, MIN_PATH_M, build_box, build_user_box, compute_first_pose

OFF_LANE_M = 4.0
"""A route point further than this from all lanes of its route is off the map; a lane change needs half a lane."""
START_GAP_M = 2.0
"""[m] Largest distance of a start from its route; in a lane wider than twice that, half the lane's width."""
OFF_MAP_M = 500.0
"""An actor further than this from the map's lanes belongs to another map; parking places lie beside the road."""
TOUCHING_M2 = 0.01
"""[m2] A smaller overlap of two boxes is rounding: files give positions to 1 mm and angles to 0.1 mrad."""


def check_scenario(scenario: Scenario, roads: RoadMap) -> None:
    """Raise InputError that names the first CAV or actor, and its point, that does not fit the network."""
    for ego in scenario.egos:
        where = f"scenario {scenario.id}: ego {ego.id}"
        _check_lanes(where, ego.lanes, roads)
        _check_points(where, ego, roads)
    lanes_xy = np.concatenate([lane.centre.xy for lane in roads.driving])
    map_box = (lanes_xy.min(0), lanes_xy.max(0))
    for actor in scenario.actors:
        where = f"scenario {scenario.id}: actor {actor.id}"
        if isinstance(actor.motion, LaneMotion):
            _check_lanes(where, actor.motion.lanes, roads)
        _check_map_bounds(where, actor, map_box)
        _check_motion_start(where, actor, roads)
        _check_start_is_free(where, actor, scenario.egos, roads)


def _check_lanes(where: str, lanes: Sequence[str], roads: RoadMap) -> None:
    for lane in lanes:
        if lane not in roads.lanes:
            raise InputError(f"{where}: expected lanes of network {roads.name}, found {lane!r}")
    for here, there in pairwise(lanes):
        lane = roads.lanes[here]
        if there not in (*lane.successors, lane.left, lane.right):
            raise InputError(f"{where}: expected a lane after or beside {here}, found {there}, which is not connected")


def _check_points(where: str, ego: Ego, roads: RoadMap) -> None:
    lanes = shapely.MultiLineString([roads.lanes[lane].centre.xy for lane in ego.lanes])
    gaps = np.atleast_1d(shapely.distance(shapely.points(ego.xy), lanes))
    worst = int(np.argmax(gaps))
    if gaps[worst] > OFF_LANE_M:
        x, y = ego.xy[worst]
        raise InputError(
            f"{where}: route point {worst} ({x:.1f}, {y:.1f}): expected within {OFF_LANE_M:g} m of its lanes,"
            f" found {gaps[worst]:.1f} m"
        )
    gap = portable.hypot(ego.start.x - ego.xy[0, 0], ego.start.y - ego.xy[0, 1])
    most = compute_max_start_gap(roads.lanes[ego.lanes[0]].width)
    if gap > most:
        raise InputError(f"{where}: start: expected within {most:g} m of the first route point, found {gap:.1f} m")


def compute_max_start_gap(lane_width: float) -> float:
    """Return how far [m] a CAV may start from the centre line of its first lane: anywhere in the lane."""
    return max(START_GAP_M, lane_width / 2)


def _check_map_bounds(where: str, actor: Actor, map_box: tuple[Float, Float]) -> None:
    """Check that all points of an actor lie near the map."""
    low, high = map_box
    points = _collect_points(actor)
    beyond = np.maximum(low - points, points - high).max(1)
    worst = int(np.argmax(beyond))
    if beyond[worst] > OFF_MAP_M:
        x, y = points[worst]
        raise InputError(
            f"{where}: ({x:.1f}, {y:.1f}): expected within {OFF_MAP_M:g} m of the map's lanes (x {low[0]:.0f} to"
            f" {high[0]:.0f}, y {low[1]:.0f} to {high[1]:.0f}), found {beyond[worst]:.0f} m beyond them"
        )


def _collect_points(actor: Actor) -> Float:
    """Return the points (N, 2) [m] that an actor defines: start, motion, trigger."""
    points = [(actor.start.x, actor.start.y)]
    match actor.motion:
        case PathMotion(points=way):
            points += way
        case ReplayMotion(poses=poses):
            points += [(x, y) for _, x, y, _ in poses]
        case _:
            pass
    if isinstance(actor.trigger, PositionTrigger):
        points.append((actor.trigger.x, actor.trigger.y))
    return np.array(points)


def _check_motion_start(where: str, actor: Actor, roads: RoadMap) -> None:
    """Check that a motion begins at the start and is not a single point."""
    begin, start = (actor.start.x, actor.start.y), (actor.start.x, actor.start.y)
    match actor.motion:
        case PathMotion(points=way):
            begin = way[0]
            if max(portable.distance(begin, point) for point in way) <= MIN_PATH_M:
                raise InputError(f"{where}: expected a path that leads somewhere, found at most {MIN_PATH_M:g} m of it")
        case LaneMotion(lanes=lanes):
            centre = roads.lanes[lanes[0]].centre
            begin = centre.at(min(max(centre.project(*start)[0], 0.0), centre.length))
        case ReplayMotion(poses=poses):
            begin = poses[0][1:3]
        case _:
            return
    if (gap := portable.distance(begin, start)) > OFF_LANE_M:
        raise InputError(
            f"{where}: start: expected within {OFF_LANE_M:g} m of where its motion begins, found {gap:.1f} m"
        )


def _check_start_is_free(where: str, actor: Actor, egos: Sequence[Ego], roads: RoadMap) -> None:
    for ego, area in find_start_overlaps(actor, egos, roads):
        raise InputError(f"{where}: start: expected room, found CAV {ego} there ({area:.2f} m2 overlap)")


def find_start_overlaps(actor: Actor, egos: Sequence[Ego], roads: RoadMap) -> Iterator[tuple[str, float]]:
    """Return ids of the CAVs that an actor overlaps in frame 0, and the overlaps [m2]; none for later arrivals."""
    if isinstance(actor.motion, ReplayMotion) and actor.motion.poses[0][0] > 0.0 and actor.trigger is None:
        return
    pose = compute_first_pose(actor, roads)
    reach = portable.hypot(actor.length, actor.width) / 2 + portable.hypot(CAR.length, CAR.width) / 2
    near = [ego for ego in egos if portable.hypot(ego.start.x - pose.x, ego.start.y - pose.y) <= reach]
    if not near:
        return
    box = build_box(pose, actor.length, actor.width)
    for ego in near:
        area = float(shapely.intersection(box, build_user_box(ego)).area)
        if area > TOUCHING_M2:
            yield ego.id, area
