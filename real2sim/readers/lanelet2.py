"""Lanelet2: convert OpenStreetMap XML with lanelets to an HdMap.

Source: Poggenhans et al., Lanelet2, ITSC 2018, and the project's documentation of its primitives and tags: a lanelet is
a relation of a left and a right way, a regulatory element a relation of signs, stop lines and the governed lanelets.
"""

import math
import re
from collections import Counter, defaultdict
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from real2sim.hd_map import HdMap, LaneKind, MapArea, MapLane, StopLine
from real2sim.readers.map_geometry import (
    compute_centreline,
    split_areas,
)
from real2sim.readers.osm_file import OsmFile, OsmRelation, OsmWay, read_osm

LANE_KIND_BY_SUBTYPE: Mapping[str, LaneKind] = {
    "road": LaneKind.DRIVING,
    "highway": LaneKind.DRIVING,
    "play_street": LaneKind.DRIVING,
    "exit": LaneKind.DRIVING,
    "bus_lane": LaneKind.DRIVING,
    "emergency_lane": LaneKind.SHOULDER,
    "road_shoulder": LaneKind.SHOULDER,
    "bicycle_lane": LaneKind.BIKE,
    "walkway": LaneKind.SIDEWALK,
    "shared_walkway": LaneKind.SIDEWALK,
    "stairs": LaneKind.SIDEWALK,
    "parking": LaneKind.PARKING,
}
"""Subtypes of lanelets. Crosswalks become polygons; other subtypes are skipped."""
DRIVABLE_SUBTYPES = ("freespace", "parking", "keepout")
"""Subtypes of multipolygons with asphalt: open areas, car parks, hatched areas."""
SIGN_BY_SUBTYPE: Mapping[str, str] = {"usR1-1": "stop", "de206": "stop", "usR1-2": "yield", "de205": "yield"}
SIGN_BY_RULE: Mapping[str, str] = {"all_way_stop": "stop", "traffic_light": "signal", "right_of_way": "yield"}
"""Meaning of a stop line by the subtype of its regulatory element, unless a sign is more specific."""
SPEED_PATTERN = re.compile(r"\s*(\d+(?:\.\d+)?)\s*(mph|km/?h|m/s|mps|)\s*")
MPS_BY_UNIT: Mapping[str, float] = {"mph": 0.44704, "m/s": 1.0, "mps": 1.0}
"""All other units are km/h, which Lanelet2 assumes for a bare number."""
STOP_LINE_GAP_M = 1.0
"""[m] Stop lines may end this far from the centre line of their lane: some are drawn short."""
CROSSWALK_WIDTHS_M = (1.5, 8.0)
"""[m] Distance between the two lines of a crosswalk."""
MIN_LENGTH_RATIO = 0.5
"""Minimum length of the shorter line relative to the longer one."""


@dataclass(frozen=True)
class _Lanelet:
    """A lanelet whose ways both run in the direction of travel."""

    relation: OsmRelation
    left: OsmWay
    right: OsmWay

    @property
    def subtype(self) -> str:
        return self.relation.tags.get("subtype", "")

    @property
    def start(self) -> tuple[str, str]:
        return self.left.nodes[0], self.right.nodes[0]

    @property
    def end(self) -> tuple[str, str]:
        return self.left.nodes[-1], self.right.nodes[-1]


@dataclass(frozen=True)
class _LaneletIndex:
    """Lanelets by start, end, left way and right way."""

    starts: Mapping[tuple[str, str], tuple[str, ...]]
    ends: Mapping[tuple[str, str], tuple[str, ...]]
    lefts: Mapping[tuple[str, ...], str]
    rights: Mapping[tuple[str, ...], str]


def read_lanelet2(path: Path, utm_origin: tuple[float, float] | None = None) -> tuple[HdMap, tuple[str, ...]]:
    """Read the map of an `.osm` file, with notes on skipped elements; raise InputError.

    Metres from the projected origin (0, 0), the frame of INTERACTION's tracks, or from `utm_origin`, see `read_osm`.
    """
    osm = read_osm(path, utm_origin)
    lanelets, faults = _build_lanelets(osm)
    roads = {lanelet.relation.id: lanelet for lanelet in lanelets if lanelet.subtype in LANE_KIND_BY_SUBTYPE}
    if not roads:
        why = f": {faults[0]}" if faults else ""
        raise InputError(f"{path}: expected at least one lanelet with the subtype road, found none{why}")
    limits, notes = _parse_limits(osm)
    if faults:
        notes += (f"{len(faults)} lanelets skipped, the first: {faults[0]}",)
    lanes = _build_lanes(osm, roads, limits)
    drawn = tuple(
        build_outline(osm.build_line(lanelet.left), osm.build_line(lanelet.right))
        for lanelet in lanelets
        if lanelet.subtype == "crosswalk"
    )
    crosswalks = drawn or find_marked_crosswalks(osm)
    stop_lines = _build_stop_lines(osm, lanes)
    unknown = Counter(
        lanelet.subtype
        for lanelet in lanelets
        if lanelet.subtype not in LANE_KIND_BY_SUBTYPE and lanelet.subtype != "crosswalk"
    )
    notes += osm.notes
    notes += tuple(f"{count} lanelets of the subtype {name!r} skipped" for name, count in sorted(unknown.items()))
    areas = tuple(area for relation in osm.list_relations("multipolygon") for area in _build_areas(osm, relation))
    return HdMap(lanes, crosswalks, stop_lines, _build_signals(osm, lanes), drivable_areas=areas), notes


def _build_areas(osm: OsmFile, relation: OsmRelation) -> tuple[MapArea, ...]:
    """Return the areas for vehicles that a multipolygon encloses, without those for other uses."""
    if relation.tags.get("subtype") not in DRIVABLE_SUBTYPES:
        return ()
    ways = [osm.build_line(lines) for lines in osm.list_ways(relation, "outer", "inner")]
    return split_areas(shapely.build_area(shapely.union_all(list(map(shapely.LineString, ways)))))


def _build_lanelets(osm: OsmFile) -> tuple[tuple[_Lanelet, ...], tuple[str, ...]]:
    """Return the lanelets, and what is wrong with those that cannot be built."""
    lanelets: list[_Lanelet] = []
    faults: list[str] = []
    for relation in osm.list_relations("lanelet"):
        try:
            lanelets.append(_build_lanelet(osm, relation))
        except InputError as error:
            faults.append(str(error))
    return tuple(lanelets), tuple(faults)


def _build_lanelet(osm: OsmFile, relation: OsmRelation) -> _Lanelet:
    left, right = (_get_side(osm, relation, role) for role in ("left", "right"))
    left_line, right_line = osm.build_line(left), osm.build_line(right)
    if measure_end_gap(left_line, right_line[::-1]) < measure_end_gap(left_line, right_line):
        right, right_line = right.reversed, right_line[::-1]
    if _compute_signed_area(np.concatenate((right_line, left_line[::-1]))) < 0:
        left, right = left.reversed, right.reversed
    return _Lanelet(relation, left, right)


def _get_side(osm: OsmFile, relation: OsmRelation, role: str) -> OsmWay:
    ways = osm.list_ways(relation, role)
    fault = next((osm.unusable_ways[id_] for id_ in relation.list_members(role) if id_ in osm.unusable_ways), "")
    if fault:
        raise InputError(f"lanelet {relation.id}: {role}: {fault}")
    if len(ways) != 1:
        raise InputError(f"lanelet {relation.id}: expected one way as {role}, found {len(ways)}")
    return ways[0]


def _compute_signed_area(ring: Float) -> float:
    """Return the signed area, positive counter-clockwise (out on the right side, back on the left)."""
    x, y = (ring - ring[0]).T
    return float(np.dot(x, np.roll(y, -1)) - np.dot(y, np.roll(x, -1))) / 2


def _build_lanes(osm: OsmFile, roads: Mapping[str, _Lanelet], limits: Mapping[str, float]) -> dict[str, MapLane]:
    links = _index_lanelets(roads)
    return {
        key: _build_lane(osm, lanelet, links, _find_limit(lanelet.relation, limits)) for key, lanelet in roads.items()
    }


def _index_lanelets(roads: Mapping[str, _Lanelet]) -> _LaneletIndex:
    starts: defaultdict[tuple[str, str], tuple[str, ...]] = defaultdict(tuple)
    ends: defaultdict[tuple[str, str], tuple[str, ...]] = defaultdict(tuple)
    for key, lanelet in roads.items():
        starts[lanelet.start] += (key,)
        ends[lanelet.end] += (key,)
    lefts = {lanelet.left.nodes: key for key, lanelet in roads.items()}
    rights = {lanelet.right.nodes: key for key, lanelet in roads.items()}
    return _LaneletIndex(starts, ends, lefts, rights)


def _build_lane(osm: OsmFile, lanelet: _Lanelet, links: _LaneletIndex, limit: float) -> MapLane:
    left, right = osm.build_line(lanelet.left), osm.build_line(lanelet.right)
    return MapLane(
        id=lanelet.relation.id,
        kind=LANE_KIND_BY_SUBTYPE[lanelet.subtype],
        centre=compute_centreline(left, right),
        left=left,
        right=right,
        entries=links.ends.get(lanelet.start, ()),
        exits=links.starts.get(lanelet.end, ()),
        left_neighbour=links.rights.get(lanelet.left.nodes, ""),
        right_neighbour=links.lefts.get(lanelet.right.nodes, ""),
        speed_limit=limit,
        directed=lanelet.relation.tags.get("one_way", "yes") != "no",
        junction="turn_direction" in lanelet.relation.tags,
    )


def _parse_limits(osm: OsmFile) -> tuple[dict[str, float], tuple[str, ...]]:
    """Return speed limits [m/s] by the id of their regulatory element, and notes on unreadable ones."""
    texts = {rule.id: rule.tags.get("sign_type", "") for rule in _list_rules(osm, "speed_limit")}
    matches = {key: SPEED_PATTERN.fullmatch(text) for key, text in texts.items()}
    limits = {key: float(match[1]) * MPS_BY_UNIT.get(match[2], 1 / 3.6) for key, match in matches.items() if match}
    notes = tuple(
        f"speed limit {key} skipped: expected sign_type such as 50 km/h, found {texts[key]!r}"
        for key, match in matches.items()
        if not match
    )
    return limits, notes


def _list_rules(osm: OsmFile, *subtypes: str) -> tuple[OsmRelation, ...]:
    return tuple(
        relation for relation in osm.list_relations("regulatory_element") if relation.tags.get("subtype") in subtypes
    )


def _find_limit(relation: OsmRelation, limits: Mapping[str, float]) -> float:
    """Return the lowest of its limits [m/s]; NaN if there is none."""
    return min(
        (limits[rule] for rule in relation.list_members("regulatory_element") if rule in limits), default=math.nan
    )


def _build_stop_lines(osm: OsmFile, lanes: Mapping[str, MapLane]) -> tuple[StopLine, ...]:
    """Return stop lines of regulatory elements, then those without one."""
    bound = {
        way.id: (rule, way)
        for rule in _list_rules(osm, "traffic_sign", *SIGN_BY_RULE)
        for way in osm.list_ways(rule, "ref_line")
    }
    loose = (way for way in osm.ways.values() if way.tags.get("type") == "stop_line" and way.id not in bound)
    drawn = [
        (osm.build_line(way), _find_sign(osm, rule), _find_governed_lanelets(osm, rule)) for rule, way in bound.values()
    ]
    drawn += [(osm.build_line(way), "", tuple(lanes)) for way in loose]
    return tuple(StopLine(line[[0, -1]], _find_crossed_lanes(line, names, lanes), sign) for line, sign, names in drawn)


def _find_sign(osm: OsmFile, rule: OsmRelation) -> str:
    signs = {SIGN_BY_SUBTYPE.get(way.tags.get("subtype", ""), "") for way in osm.list_ways(rule, "refers")} - {""}
    return min(signs) if signs else SIGN_BY_RULE.get(rule.tags.get("subtype", ""), "")


def _find_governed_lanelets(osm: OsmFile, rule: OsmRelation) -> tuple[str, ...]:
    """Return lanelets that refer to the rule, or that the rule requires to yield."""
    naming = (
        relation.id
        for relation in osm.list_relations("lanelet")
        if rule.id in relation.list_members("regulatory_element")
    )
    return tuple(dict.fromkeys((*rule.list_members("yield"), *naming)))


def _find_crossed_lanes(line: Float, names: tuple[str, ...], lanes: Mapping[str, MapLane]) -> tuple[str, ...]:
    drawn = shapely.LineString(line)
    return tuple(
        name
        for name in names
        if name in lanes and drawn.distance(shapely.LineString(lanes[name].centre)) < STOP_LINE_GAP_M
    )


def _build_signals(osm: OsmFile, lanes: Mapping[str, MapLane]) -> dict[str, tuple[str, ...]]:
    lights = {rule.id: _find_governed_lanelets(osm, rule) for rule in _list_rules(osm, "traffic_light")}
    return {key: tuple(name for name in names if name in lanes) for key, names in lights.items()}


def find_marked_crosswalks(osm: OsmFile) -> tuple[Float, ...]:
    """Return polygons (N, 2) [m] between pedestrian markings that are mutually nearest and similar in length."""
    marked = [osm.build_line(way) for way in osm.ways.values() if way.tags.get("type") == "pedestrian_marking"]
    if len(marked) < 2:
        return ()
    lines = shapely.get_parts(shapely.line_merge(shapely.MultiLineString(marked)))
    apart = np.array([[line.hausdorff_distance(other) for other in lines] for line in lines])
    np.fill_diagonal(apart, np.inf)
    nearest = apart.argmin(axis=1)
    pairs = ((first, int(other)) for first, other in enumerate(nearest) if nearest[other] == first < other)
    return tuple(
        _build_polygon(lines[first], lines[other]) for first, other in pairs if _is_pair(lines[first], lines[other])
    )


def _is_pair(line: shapely.LineString, other: shapely.LineString) -> bool:
    alike = min(line.length, other.length) >= MIN_LENGTH_RATIO * max(line.length, other.length)
    return (
        alike
        and CROSSWALK_WIDTHS_M[0] <= line.interpolate(0.5, normalized=True).distance(other) <= CROSSWALK_WIDTHS_M[1]
    )


def _build_polygon(edge: shapely.LineString, other: shapely.LineString) -> Float:
    left, right = (np.asarray(line.coords, dtype=np.float64)[:, :2] for line in (edge, other))
    return build_outline(
        left, right if measure_end_gap(left, right) <= measure_end_gap(left, right[::-1]) else right[::-1]
    )


def build_outline(left: Float, right: Float) -> Float:
    """Return the polygon (N, 2) [m] between two lines with the same direction."""
    return np.concatenate((right, left[::-1]))


def measure_end_gap(line: Float, other: Float) -> float:
    """Return the sum of the gaps [m] between both starts and both ends."""
    return float(np.hypot(*(line[[0, -1]] - other[[0, -1]]).T).sum())
