"""Strips beside streets on which riders come, and the ways through a junction that cross them."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
import shapely

from mdrive_sumo.contract.briefing import JunctionKind
from mdrive_sumo.generate.hard.sites.crossroads import Crossroads, find_crossroads
from mdrive_sumo.generate.hard.sites.junction_ways import JunctionWay
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.worlds.placement.lane_chains import Lanes, build_pose_line, build_route_line, compute_pose

STEP_M = 0.1
"""[m] Distance of the stations among which a crossing is sought, ..."""
REACH_M = 15.0
"""[m] ... from so far before the junction to so far behind it: a lane, a parking lane, a cycle track and a pavement."""
STRIP_STEP_M = 2.0
"""[m] Between the points of the line of a strip."""
FREE_STEP_M = 0.5
"""[m] Between the places at which it is looked what stands in the way of riders, ..."""
CLEAR_M = 0.2
"""[m] ... from which they keep this distance, ..."""
RIM_M = 2.0
"""[m] ... and in front of which they appear and leave: the length of a bicycle."""


@dataclass(frozen=True, slots=True)
class RiderSite:
    """A street along which riders come, and a way that crosses their line at its left edge."""

    lanes: Lanes
    """Of the street, in the direction of the riders."""
    edge_m: float
    """[m] From these lanes to the edge of the street where the riders come, to the left."""
    way: JunctionWay
    facing: JunctionWay | None = None
    """The way from the opposite approach."""


@dataclass(frozen=True)
class RiderStrip:
    """The line on which riders come, `offset` [m] to the left of lanes."""

    roads: RoadMap
    lanes: Lanes
    offset: float

    @cached_property
    def line(self) -> shapely.LineString:
        """It as a line."""
        stations = np.arange(0.0, build_route_line(self.roads, self.lanes).curve.length, STRIP_STEP_M)
        return build_pose_line([compute_pose(self.roads, self.lanes, one, self.offset) for one in stations.tolist()])

    def find_free(self, stations_m: tuple[float, float, float], half_m: float) -> tuple[float, float]:
        """Return between which stations [m] around the middle one, at most from the first to the last one, nothing
        stands in the way of riders of half that width [m]."""
        first_m, at_m, last_m = stations_m
        end_m = min(last_m, build_route_line(self.roads, self.lanes).curve.length)
        stations = np.arange(max(first_m, 0.0), end_m, FREE_STEP_M)
        poses = [compute_pose(self.roads, self.lanes, one, self.offset) for one in stations.tolist()]
        points = shapely.points([(pose.x, pose.y) for pose in poses])
        tree = shapely.STRtree(self.roads.building_shapes)
        met = stations[tree.query(points, predicate="dwithin", distance=half_m + CLEAR_M)[0]]
        before, behind = met[met <= at_m], met[met > at_m]
        return (
            float(before.max() + RIM_M if len(before) else stations[0]),
            float(behind.min() - RIM_M if len(behind) else end_m),
        )

    def find_met(self, way: JunctionWay) -> tuple[float, float] | None:
        """Return the stations [m] on a way and on the lanes at which the way first crosses the strip; None if it does
        not near its junction."""
        own = build_route_line(self.roads, way.lanes).curve
        along = build_route_line(self.roads, self.lanes).curve
        last = min(way.exit_m + REACH_M, own.length)
        stations = np.arange(max(way.stop_m - REACH_M, 0.0), last, STEP_M).tolist()
        places = [along.project(*own.at(station)) for station in stations]
        sides = np.array([aside for _, aside in places]) > self.offset
        changes = np.flatnonzero(sides[1:] != sides[:-1])
        return (stations[int(changes[0])], places[int(changes[0])][0]) if len(changes) else None


@lru_cache(maxsize=128)
def find_crossing_sites(
    roads: RoadMap, controls: tuple[JunctionKind | None, ...], beside_lane: bool
) -> tuple[RiderSite, ...]:
    """Return the approaches with one of these controls at which riders come from the right before the street that
    they cross; beside_lane: those with another lane at their right, otherwise those without."""
    found = {one.meeting.own: one for one in find_crossroads(roads, controls) if one.far is not None}
    return tuple(
        _build_crossing_site(roads, one)
        for own, one in found.items()
        if (roads.lanes[own.approach].right != "") == beside_lane and _are_of_both_sides(one)
    )


def _are_of_both_sides(site: Crossroads) -> bool:
    return len({one.from_left for one in site.others}) > 1


def _build_crossing_site(roads: RoadMap, site: Crossroads) -> RiderSite:
    near, far = sorted(site.others, key=lambda one: not one.from_left)
    pose = compute_pose(roads, near.other.lanes, near.other_m)
    _, aside = build_route_line(roads, far.other.lanes).curve.project(pose.x, pose.y)
    return RiderSite(
        far.other.lanes, aside + roads.lanes[near.other.approach].width / 2, near.own, site.back and site.back.own
    )


def find_opposite(roads: RoadMap, site: RiderSite, others: Sequence[RiderSite]) -> RiderSite | None:
    """Return the site of the approach that faces that of a site."""
    facing = "" if site.facing is None else roads.lanes[site.facing.approach].edge
    return next((one for one in others if roads.lanes[one.way.approach].edge == facing), None)
