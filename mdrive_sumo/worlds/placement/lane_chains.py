"""Chains of lanes as lines: stations along them, poses beside them, and where two of them come together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from itertools import pairwise

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float, Polyline
from mdrive_sumo.roads import Lane, RoadMap, build_lane_route
from mdrive_sumo.roads.routing import LANE_CHANGE_M
from mdrive_sumo.scenario.scenario import Ego
from mdrive_sumo.scenario.scenario_part import Pose
from mdrive_sumo.worlds.lane_routes import LaneRoute

MEETING_M = 1.6
"""[m] Chains within this distance of each other conflict."""
Lanes = tuple[str, ...]
"""SUMO lane ids in driving order, junction lanes included; a lane change lists both lanes. `roads.find_lane_path`
finds them from the first to the last lane."""
Spot = tuple[float, float]
"""x, y [m]."""


@dataclass(frozen=True, slots=True)
class RouteLaneChange:
    """The lane change of a route: where it begins on the lane that it leaves [m], and its length [m]."""

    at_m: float
    length_m: float = LANE_CHANGE_M


@dataclass(frozen=True, eq=False)
class RouteLine:
    """A chain of lanes as a line: points (N, 2) [m] a metre apart, and the direction (N,) [rad] of the lane there."""

    xy: Float
    yaw: Float

    @property
    def last_m(self) -> int:
        """Station [m] of the last point, in whole metres."""
        return len(self.xy) - 1

    @cached_property
    def curve(self) -> Polyline:
        """The line measured by its arc length."""
        return Polyline(self.xy)

    def locate(self, x: float, y: float) -> float:
        """Return the station [m] that is nearest to a point."""
        return float(shapely.line_locate_point(shapely.LineString(self.xy), shapely.Point(x, y)))


RouteLines = Mapping[str, RouteLine]
"""Lines by vehicle id."""


@lru_cache(maxsize=4096)
def build_route_line(roads: RoadMap, lanes: Lanes, change: RouteLaneChange | None = None) -> RouteLine:
    """Return the line along whole lanes."""
    end_m = roads.lanes[lanes[-1]].centre.length
    if change is None:
        route = build_lane_route(roads, lanes, 0.0, end_m)
    else:
        changes = {i: change.at_m for i, pair in enumerate(pairwise(lanes)) if are_neighbours(roads, *pair)}
        route = build_lane_route(roads, lanes, 0.0, end_m, changes, change.length_m)
    return RouteLine(route.xy, route.yaw)


def are_neighbours(roads: RoadMap, here: str, there: str) -> bool:
    """Return whether two lanes lie side by side on one road: a lane change leads from one to the other."""
    return there in (roads.lanes[here].left, roads.lanes[here].right)


def build_lane_change(roads: RoadMap, way: LaneRoute, share: float) -> RouteLaneChange | None:
    """Return the lane change of a route, which begins at that share of the lane that it leaves; None without one."""
    if way.change_index < 0:
        return None
    return RouteLaneChange(share * roads.lanes[way.lanes[way.change_index]].centre.length)


def build_way_line(roads: RoadMap, way: LaneRoute, change_share: float) -> RouteLine:
    """Return the line of a lane route, whose lane change begins at that share of the lane that it leaves."""
    return build_route_line(roads, way.lanes, build_lane_change(roads, way, change_share))


@lru_cache(maxsize=4096)
def find_conflict_stations(one: RouteLine, other: RouteLine) -> tuple[float, float] | None:
    """Return the stations [m] at which two routes first come together after having been apart; None if they never
    do."""
    near = np.asarray(shapely.distance(shapely.points(one.xy), shapely.LineString(other.xy)) < MEETING_M)
    if near[0] or not near.any():  # they begin together: a queue
        return None
    i = int(np.argmax(near))
    return float(i), other.locate(*one.xy[i].tolist())


def compute_chain_length(roads: RoadMap, lanes: Lanes) -> float:
    """Return the length [m] of a chain of lanes."""
    return build_route_line(roads, lanes).curve.length


def find_station(roads: RoadMap, lanes: Lanes, x: float, y: float) -> float:
    """Return the station [m] along a chain of lanes that is nearest to a point."""
    return build_route_line(roads, lanes).curve.project(x, y)[0]


def compute_lane_begins(roads: RoadMap, lanes: Lanes) -> list[float]:
    """Return the stations [m] at which the lanes of a chain begin; a lane change does not add to them."""
    begins = [0.0]
    for here, there in pairwise(lanes):
        begins.append(begins[-1] + (0.0 if are_neighbours(roads, here, there) else roads.lanes[here].centre.length))
    return begins


def select_lanes(roads: RoadMap, lanes: Lanes, start_m: float, goal_m: float) -> Lanes:
    """Return the lanes of a chain between two stations [m]."""
    begins = compute_lane_begins(roads, lanes)
    ends = [begin + roads.lanes[lane].centre.length for begin, lane in zip(begins, lanes, strict=True)]
    first = next((i for i, end in enumerate(ends) if end > start_m), 0)
    last = max(i for i, begin in enumerate(begins) if begin < goal_m)
    return lanes[first : last + 1]


def build_pose(x: float, y: float, yaw: float, offset: float = 0.0) -> Pose:
    """Return the pose `offset` [m] to the left of another one, rounded as scenario files are."""
    x, y = x - offset * portable.sin(yaw), y + offset * portable.cos(yaw)
    return Pose(x=round(x, 3), y=round(y, 3), yaw=round(yaw, 4))


def compute_pose(roads: RoadMap, lanes: Lanes, station: float, offset: float = 0.0) -> Pose:
    """Return the pose at a station [m] along a chain of lanes, `offset` [m] to its left."""
    curve = build_route_line(roads, lanes).curve
    return build_pose(*curve.at(station), curve.yaw_at(station), offset)


def compute_lane_pose(lane: Lane, station: float, offset: float = 0.0) -> Pose:
    """Return the pose at a station [m] on a lane, `offset` [m] to the left of its centre line."""
    return build_pose(*lane.centre.at(station), lane.centre.yaw_at(station), offset)


def build_pose_line(poses: Sequence[Pose]) -> shapely.LineString:
    """Return the line through the positions of poses."""
    return shapely.LineString([(pose.x, pose.y) for pose in poses])


def compute_route_pose(ego: Ego, station: float, offset: float) -> tuple[float, float, float]:
    """Return the pose [m, m, rad] beside a CAV's route, `offset` [m] to its left."""
    k = min(max(round(station), 0), len(ego.route) - 1)
    x, y, yaw = ego.route[k]
    along = station - k
    x, y = x + along * portable.cos(yaw), y + along * portable.sin(yaw)
    return x - offset * portable.sin(yaw), y + offset * portable.cos(yaw), yaw
