"""Does a scenario fit its network? Asked before anything is simulated, so that a bad file gets one clear sentence."""

import math

import numpy as np
import shapely

from mdrive_sumo.errors import InputError
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.spec import Ego, Scenario

OFF_LANE_M = 4.0
"""A route point further than this from all lanes of its route is off the map; a lane change needs half a lane."""
START_GAP_M = 2.0


def check_scenario(scenario: Scenario, roads: RoadMap) -> None:
    """Raises InputError naming the first CAV and point where scenario and network do not fit together."""
    for ego in scenario.egos:
        where = f"scenario {scenario.id}: ego {ego.id}"
        _check_lanes(where, ego, roads)
        _check_points(where, ego, roads)


def _check_lanes(where: str, ego: Ego, roads: RoadMap) -> None:
    for lane in ego.lanes:
        if lane not in roads.lanes:
            raise InputError(f"{where}: expected lanes of network {roads.name}, found {lane!r}")
    for here, there in zip(ego.lanes, ego.lanes[1:], strict=False):
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
    gap = math.hypot(ego.start.x - ego.xy[0, 0], ego.start.y - ego.xy[0, 1])
    if gap > START_GAP_M:
        raise InputError(
            f"{where}: start: expected within {START_GAP_M:g} m of the first route point, found {gap:.1f} m"
        )
