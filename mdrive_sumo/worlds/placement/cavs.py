"""CAVs on chains of lanes: from one station to another, or from a spawn point to a goal of a lane route."""

from dataclasses import dataclass

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads import RoadMap, Route, build_lane_route
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.worlds.lane_routes import LaneRoute
from mdrive_sumo.worlds.placement.lane_chains import (
    Lanes,
    RouteLaneChange,
    build_lane_change,
    build_route_line,
    compute_lane_begins,
    select_lanes,
)

LEAST_ROUTE_M = 10.0
"""[m] A route is twice a car's length or more; chosen."""


class NoRoomError(InputError):
    """A road user has no room where it is asked for; another draw may have."""


def build_ego(name: str, route: Route, start_speed: float = 0.0) -> Ego:
    """Return the CAV that drives a dense route, rounded as scenario files are, from its first point at that speed."""
    xy, yaws = route.xy.tolist(), route.yaw.tolist()
    points = tuple((round(x, 3), round(y, 3), round(yaw, 4)) for (x, y), yaw in zip(xy, yaws, strict=True))
    x, y, yaw = points[0]
    start = Pose(x=x, y=y, yaw=yaw)
    return Ego(id=name, start=start, start_speed=round(start_speed, 2), lanes=route.lanes, route=points)


@dataclass(frozen=True, slots=True)
class SpawnPoint:
    """Stations [m] of start and goal on a line."""

    start: float
    goal: float


def build_spawned_cav(roads: RoadMap, name: str, way: LaneRoute, spawn: SpawnPoint, change_share: float) -> Ego:
    """Return the CAV that drives a lane route from start to goal, at rest on the first point of its dense route."""
    begins = compute_lane_begins(roads, way.lanes)
    lengths = [roads.lanes[lane].centre.length for lane in way.lanes]
    ends = [begin + length for begin, length in zip(begins, lengths, strict=True)]
    first = next(i for i, end in enumerate(ends) if spawn.start < end - 1.0)
    last = next(i for i, end in enumerate(ends) if spawn.goal <= end + 1.0 and i >= first and i != way.change_index)
    goal_s = min(spawn.goal - begins[last], lengths[last])
    change = build_lane_change(roads, way, change_share)
    changes = {} if change is None or way.change_index < first else {way.change_index - first: change.at_m}
    lanes = way.lanes[first : last + 1]
    return build_ego(name, build_lane_route(roads, lanes, spawn.start - begins[first], goal_s, changes))


def build_cav(
    roads: RoadMap,
    name: str,
    lanes: Lanes,
    drive: tuple[float, float],
    speed: float,
    change: RouteLaneChange | None = None,
) -> Ego:
    """Return a CAV that drives along a chain of lanes, starting at `speed` [m/s]; `drive`: stations [m] of both ends.

    Without `change` a lane change takes 20 m, which suits urban speeds. Raises NoRoomError if the CAV does not lie on
    the chain.
    """
    start_m, goal_m = drive
    line = build_route_line(roads, lanes, change)
    if not 0.0 <= start_m < goal_m - LEAST_ROUTE_M or goal_m > line.curve.length:
        raise NoRoomError(
            f"{name}: expected at least {LEAST_ROUTE_M:.0f} m of route within {line.curve.length:.0f} m of lanes,"
            f" found {start_m:.0f} to {goal_m:.0f} m"
        )
    stations = np.arange(start_m, goal_m, 1.0)
    xy: Float = np.array([line.curve.at(station) for station in stations.tolist()])
    yaws = np.interp(stations, np.arange(len(line.yaw)), line.yaw)
    return build_ego(name, Route(select_lanes(roads, lanes, start_m, goal_m), xy, yaws), speed)
