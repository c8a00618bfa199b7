"""Where at a junction nothing stands: between the extended kerb lines of the streets that cross, and on zebras.

Nearer than 5 m to where the kerbs meet parking is forbidden (StVO section 12 (3) 1), and delivery vehicles stop there.
Beyond the kerb line of the other street, or on a pedestrian crossing, they would stand in traffic.
"""

from functools import lru_cache

import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.generate.hard.sites.crossroads import are_opposite
from mdrive_sumo.generate.hard.sites.junction_ways import JunctionWay, find_junction_ways
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.worlds.placement.lane_chains import build_route_line


@lru_cache(maxsize=128)
def build_zebras(roads: RoadMap) -> BaseGeometry:
    """Return the pedestrian crossings of a place [m]."""
    return shapely.union_all(
        [shapely.LineString(xy).buffer(wide / 2, cap_style="flat") for xy, wide in roads.crossings]
    )


@lru_cache(maxsize=1024)
def build_crossing_street(roads: RoadMap, way: JunctionWay) -> BaseGeometry:
    """Return the carriageway [m] of the street that crosses that of a way in its junction, cycle lanes included."""
    return shapely.union_all(
        [
            _build_carriageway(roads, one)
            for one in find_junction_ways(roads)
            if (one.junction, one.turn) == (way.junction, "straight")
            and roads.lanes[one.approach].edge != roads.lanes[way.approach].edge
            and not are_opposite(roads, one, way)
        ]
    )


def _build_carriageway(roads: RoadMap, way: JunctionWay) -> BaseGeometry:
    """Return what a way through a junction and the cycle lanes at its right take of it [m]."""
    lane = roads.lanes[way.approach]
    cycle_m = sum(one.width for one in roads.cycle_lanes.values() if one.edge == lane.edge)
    line = shapely.LineString(build_route_line(roads, way.lanes).xy[int(way.stop_m) : int(way.exit_m) + 2])
    right = line.buffer(-(lane.width / 2 + cycle_m), cap_style="flat", single_sided=True)
    return line.buffer(lane.width / 2, cap_style="flat").union(right)
