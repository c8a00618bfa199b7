"""Build the map of a recorded episode from the network it was driven on."""

from collections import defaultdict
from collections.abc import Iterator, Mapping

import shapely

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.export.lane_bounds import find_predecessors, offset_points
from mdrive_sumo.roads import Lane, RoadMap
from real2sim.hd_map import HdMap, LaneKind, MapLane, StopLine
from real2sim.readers.map_geometry import build_cross_line

SPACING_M = 0.5
"""[m] Maximum distance between points of a lane, as in V2XPnP's maps."""


def build_hd_map(roads: RoadMap) -> HdMap:
    """Build the HD map of a network: car lanes with boundaries, links, neighbours, limits; crosswalks, signs.

    Footways are omitted: a RoadMap contains only their outlines.
    """
    entries = find_predecessors(roads)
    return HdMap(
        lanes={lane.id: _build_lane(lane, entries[lane.id]) for lane in roads.driving},
        crosswalks=tuple(_build_crosswalk(line, width) for line, width in roads.crossings),
        stop_lines=tuple(_build_stop_lines(roads)),
        signals=_build_signals(roads),
    )


def _build_lane(lane: Lane, entries: tuple[str, ...]) -> MapLane:
    line = shapely.segmentize(shapely.LineString(lane.centre.xy), SPACING_M)
    centre: Float = shapely.get_coordinates(line)
    return MapLane(
        id=lane.id,
        kind=LaneKind.DRIVING,
        centre=centre,
        left=offset_points(centre, lane.width / 2),
        right=offset_points(centre, -lane.width / 2),
        entries=entries,
        exits=lane.successors,
        left_neighbour=lane.left,
        right_neighbour=lane.right,
        group=lane.edge,
        width=lane.width,
        speed_limit=lane.speed_limit,
        junction=lane.junction,
    )


def _build_crosswalk(line: Float, width: float) -> Float:
    strip = shapely.buffer(shapely.LineString(line), width / 2, cap_style="flat")
    return shapely.get_coordinates(shapely.get_exterior_ring(strip))[:-1]


def _build_stop_lines(roads: RoadMap) -> Iterator[StopLine]:
    for sign in roads.stop_signs or ():
        lane = roads.lanes[sign.lane]
        yield StopLine(build_cross_line(lane.centre, sign.line_pos_m, lane.width), (lane.id,), "stop")


def _build_signals(roads: RoadMap) -> Mapping[str, tuple[str, ...]]:
    """Return traffic light id -> ids of the lanes it controls."""
    lanes: defaultdict[str, list[str]] = defaultdict(list)
    for lane in roads.driving:
        for light in sorted({link.rpartition(":")[0] for link in lane.lights.values()}):
            lanes[light].append(lane.id)
    return {light: tuple(controlled) for light, controlled in lanes.items()}
