"""Check the compiled network of a place: sentences about what is wrong."""

import json
from collections.abc import Iterable, Iterator, Mapping
from itertools import pairwise

import numpy as np
import shapely

from mdrive_sumo.core import portable
from mdrive_sumo.core.geometry import Float
from mdrive_sumo.core.input_files import read_bytes
from mdrive_sumo.roads import Lane, RoadMap
from mdrive_sumo.worlds.places.place import PLACE_FILE
from mdrive_sumo.worlds.places.sight_triangles import EYE_M, compute_leg

LEAST_LANE_M = 2.0
"""[m] Between junctions closer than that, lanes vanish in netconvert's corners."""
RING = "ring_"
"""Edges of roundabouts, whose pieces between exit and entry of an arm are as short as the arm's island is wide."""
LEAST_MERGE_M = 60.0
"""[m] Length of a lane that ends, such as an acceleration lane; chosen: four seconds at 50 km/h."""
LEAST_WAY_M = 80.0
"""[m] Least length of the longest way from each entry: ten seconds at 8 m/s, the speed of CAVs in the protocol."""
LEAST_RADIUS_M = 5.5
"""A car with a wheelbase of 2.85 m turns it with 27 deg of steering."""
BEND_WINDOW_M = 3
"""[m] Over which a bend is measured: half of a car."""
ON_ROAD_M2 = 0.01
"""[m²] Smaller overlaps of a building and a road are rounding to 0.1 m."""
ROUNDING_M = 3.0
"""[m] Left out of sight lines at their far end: netconvert places stop lines, from which legs are measured, by its own
rules."""
EYE_SEARCH_M = 30.0
"""[m] Beyond the stop line, which netconvert places where the rounding of the corner begins."""
ROAD_WIDTH_M, PARALLEL = 16.0, 0.94
"""[m] Lanes whose ends are closer than that, and whose directions differ by 20 deg or less (cosine), are one road."""
POSTS = "tree"
"""Trunks may stand in sight triangles, as lamp posts may (RASt 06, 6.3.9.3): they hide no vehicle for long."""


def check_place(roads: RoadMap) -> list[str]:
    """Return a sentence for each fault of the network of a place; none for a sound one."""
    return [
        *_check_lanes(roads),
        *_check_ways(roads),
        *_check_turns(roads),
        *_check_buildings(roads),
        *_check_sight(roads),
    ]


def _check_lanes(roads: RoadMap) -> Iterator[str]:
    """Find lanes that are too short, and lanes that end too soon."""
    streets = [lane for lane in roads.driving if not lane.junction]
    goes_on = {lane.edge for lane in streets if lane.successors}
    for lane in streets:
        if lane.centre.length < LEAST_LANE_M and not lane.edge.startswith(RING):
            yield f"lane {lane.id}: {lane.centre.length:.1f} m long, expected {LEAST_LANE_M:g} m or more"
        if lane.edge in goes_on and not lane.successors and lane.centre.length < LEAST_MERGE_M:
            yield f"lane {lane.id}: ends while its edge goes on, expected {LEAST_MERGE_M:g} m to leave it"


def _check_ways(roads: RoadMap) -> Iterator[str]:
    """Find entries that reach no exit, or none far enough, and exits that no entry reaches."""
    has_predecessor = {successor for lane in roads.driving for successor in lane.successors}
    streets = [lane for lane in roads.driving if not lane.junction]
    fed = {roads.lanes[name].edge for name in has_predecessor if name in roads.lanes}
    entries = [lane for lane in streets if lane.edge not in fed]
    exits = {lane.edge for lane in streets} - {lane.edge for lane in streets if lane.successors}
    reached: set[str] = set()
    for lane in entries:
        lengths = _measure_ways(roads, lane)
        ends = {roads.lanes[name].edge for name in lengths} & exits
        reached |= ends
        if not ends:
            yield f"lane {lane.id}: reaches no exit"
        elif max(lengths.values()) < LEAST_WAY_M:
            yield f"lane {lane.id}: its longest way has less than {LEAST_WAY_M:g} m"
    if not entries:
        yield "no lane enters the place"
    for edge in sorted(exits - reached):
        yield f"edge {edge}: is an exit that no entry reaches"


def _measure_ways(roads: RoadMap, start: Lane) -> Mapping[str, float]:
    """Return the shortest distance [m] from the begin of a lane to the end of each lane that it reaches."""
    lengths = {start.id: start.centre.length}
    waiting = [start]
    while waiting:
        lane = waiting.pop()
        for name in (*lane.successors, lane.left, lane.right):
            if name not in roads.lanes:
                continue
            is_ahead = name in lane.successors
            length = lengths[lane.id] + (roads.lanes[name].centre.length if is_ahead else 0.0)
            if length < lengths.get(name, np.inf):
                lengths[name] = length
                waiting.append(roads.lanes[name])
    return lengths


def _check_turns(roads: RoadMap) -> Iterator[str]:
    """Find lanes of junctions that a car cannot follow."""
    for lane in roads.driving:
        if lane.junction and lane.centre.length > BEND_WINDOW_M + 1:
            yaws = np.unwrap(lane.centre.resample(1.0).yaws)
            bend = float(np.abs(yaws[BEND_WINDOW_M:] - yaws[:-BEND_WINDOW_M]).max()) / BEND_WINDOW_M
            if bend > 1 / LEAST_RADIUS_M:
                yield f"lane {lane.id}: bends with a radius of {1 / bend:.1f} m, expected {LEAST_RADIUS_M:g} m or more"


def _check_buildings(roads: RoadMap) -> Iterator[str]:
    """Find buildings and other obstacles on lanes and pavements, and buildings that are no simple polygons."""
    surface = shapely.union_all([_build_strip(lane) for lane in roads.driving])
    walks = shapely.union_all([shapely.Polygon(outline).buffer(0) for outline in roads.pavements])
    for building, shape in zip(roads.buildings, roads.building_shapes, strict=True):
        if not shape.is_valid:
            yield f"building {building.id}: expected a simple polygon"
        for what, area in (("lane", surface), ("pavement", walks)):
            if shape.buffer(0).intersection(area).area > ON_ROAD_M2:
                yield f"building {building.id}: stands on a {what}"


def _build_strip(lane: Lane) -> shapely.Geometry:
    return shapely.LineString(lane.centre.xy).buffer(lane.width / 2, cap_style="flat")


def _check_sight(roads: RoadMap) -> Iterator[str]:
    """Find obstacles in sight triangles: from a lane that gives way, by sign or to the right, to one with priority."""
    if not roads.buildings or not _keeps_sight(roads):
        return
    walls = [building for building in roads.buildings if not building.id.startswith(POSTS)]
    tree = shapely.STRtree([shapely.Polygon(wall.polygon) for wall in walls])
    for waiting, other in _list_conflicts(roads):
        eye = _find_eye(roads, waiting, other)
        to_crossing_m = _measure_distance(eye, other.centre.xy[-1])  # the leg begins where roads cross
        leg_m = compute_leg(other.speed_limit) - to_crossing_m
        stations = np.arange(0.5, min(leg_m, other.centre.length) - ROUNDING_M, 5.0)
        line = shapely.LineString(other.centre.xy[::-1])
        for point in shapely.get_coordinates(line.interpolate(stations)):
            hit = tree.query(shapely.LineString((eye, point)), predicate="intersects")
            if len(hit):
                yield f"building {walls[int(hit[0])].id}: hides {other.id} from {waiting.id}"
                break


def _find_eye(roads: RoadMap, waiting: Lane, other: Lane) -> Float:
    """Return where the eyes of a driver who waits are: straight on from the stop line, 3 m from the road of `other`."""
    end, ahead = waiting.centre.xy[-1], _get_direction(waiting)
    begin, across = other.centre.xy[-1], _get_direction(other)
    beside = [lane for lane in roads.driving if not lane.junction and _runs_beside(lane, begin, across)]
    strips = [
        shapely.LineString((point, point + EYE_SEARCH_M * across)).buffer(lane.width / 2)
        for lane in (other, *beside)
        for point in (lane.centre.xy[-1], lane.centre.xy[0])
        if _measure_distance(point, begin) < ROAD_WIDTH_M
    ]
    road = shapely.union_all(strips)
    points = (end + ahead * station for station in np.arange(0.0, EYE_SEARCH_M, 0.5))
    return next((point for point in points if road.distance(shapely.Point(point)) <= EYE_M), end)


def _runs_beside(lane: Lane, end: Float, direction: Float) -> bool:
    """Return whether a lane belongs to the road of a lane that ends at `end` in a direction: either way."""
    first, last = lane.centre.xy[0], lane.centre.xy[-1]
    if _measure_distance(last, end) < ROAD_WIDTH_M:
        return bool(portable.dot(_get_direction(lane), direction) > PARALLEL)
    outward = lane.centre.xy[1] - first
    is_opposite = portable.dot(outward, direction) < -PARALLEL * _measure_distance(lane.centre.xy[1], first)
    return bool(is_opposite) and _measure_distance(first, end) < ROAD_WIDTH_M


def _measure_distance(point: Float, other: Float) -> float:
    return float(portable.hypot(float(point[0] - other[0]), float(point[1] - other[1])))


def _keeps_sight(roads: RoadMap) -> bool:
    """Return whether the place was drawn with free sight triangles."""
    path = roads.folder / PLACE_FILE
    if not path.is_file():
        return False
    return bool(json.loads(read_bytes(path)).get("parameters", {}).get("keeps_sight", True))


def _list_conflicts(roads: RoadMap) -> Iterator[tuple[Lane, Lane]]:
    """Return pairs of lanes into a junction without signals: one that gives way, and one that has priority over it."""
    signed = {sign.lane for sign in (*(roads.stop_signs or ()), *roads.yield_signs)}
    for lanes in _group_by_junction(roads.driving).values():
        if any(lane.lights for lane in lanes):
            continue
        has_signs = any(lane.id in signed for lane in lanes)
        for waiting in lanes:
            for other in lanes:
                if other.edge == waiting.edge:
                    continue
                if (has_signs and waiting.id in signed and other.id not in signed) or (
                    not has_signs and len({lane.edge for lane in lanes}) > 2 and _comes_from_right(waiting, other)
                ):
                    yield waiting, other


def _group_by_junction(lanes: Iterable[Lane]) -> Mapping[str, list[Lane]]:
    groups: dict[str, list[Lane]] = {}
    for lane in lanes:
        inside = next((name for name in lane.successors if name.startswith(":")), "")
        if inside and not lane.junction:
            groups.setdefault(inside.rsplit("_", 2)[0], []).append(lane)
    return groups


def _comes_from_right(waiting: Lane, other: Lane) -> bool:
    ahead, across = (_get_direction(lane) for lane in (waiting, other))
    turn = float(ahead[0] * across[1] - ahead[1] * across[0])
    return turn > 0.5  # sine of 30 degrees: smaller angles are oncoming or alongside


def _get_direction(lane: Lane) -> Float:
    (before, end) = next(reversed([*pairwise(lane.centre.xy)]))
    step = end - before
    return step / portable.hypot(float(step[0]), float(step[1]))
