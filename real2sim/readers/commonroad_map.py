"""CommonRoad: convert the lanelet network of commonroad-io to an HdMap."""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float
from real2sim.hd_map import HdMap, LaneKind, MapLane, StopLine
from real2sim.readers.input_checks import parse_points

LANE_KIND_BY_TYPE: Mapping[str, LaneKind] = {
    "sidewalk": LaneKind.SIDEWALK,
    "bicycleLane": LaneKind.BIKE,
    "parking": LaneKind.PARKING,
    "shoulder": LaneKind.SHOULDER,
    "border": LaneKind.SHOULDER,
    "restricted_area": LaneKind.SHOULDER,
}
"""Applied to the first matching type of a lanelet; all other lanelets are for driving."""
MIN_OVERLAP_M2 = 1.0
"""[m²] Smaller overlaps come from imprecise drawing of neighbours, not from crossing lanes."""
SIGN_BY_NAME: Mapping[str, str] = {"STOP": "stop", "YIELD": "yield"}


def build_commonroad_map(path: Path, network: Any) -> HdMap:
    """Build the map; raise InputError if a lanelet is not a line."""
    signs = {sign.traffic_sign_id: sign for sign in network.traffic_signs}
    lanelets = [lanelet for lanelet in network.lanelets if "crosswalk" not in _get_types(lanelet)]
    inside = _find_junction_lanelets(path, network)
    lanes = {str(lanelet.lanelet_id): _build_lane(path, lanelet, signs, inside) for lanelet in lanelets}
    if not lanes:
        raise InputError(f"{path}: expected at least one lanelet for vehicles, found crosswalks only")
    return HdMap(
        lanes=lanes,
        crosswalks=tuple(
            _build_outline(path, lanelet) for lanelet in network.lanelets if "crosswalk" in _get_types(lanelet)
        ),
        stop_lines=tuple(line for lanelet in lanelets for line in _build_stop_lines(lanelet, signs)),
        signals=_build_signals(lanelets),
    )


def _get_types(lanelet: Any) -> frozenset[str]:
    return frozenset(lane_type.value for lane_type in lanelet.lanelet_type)


def _find_junction_lanelets(path: Path, network: Any) -> frozenset[int]:
    """Return lanelets inside intersections: those listed, and their successors while they overlap other lanelets.

    Intersections list only the first lanelet after each incoming one.
    """
    areas = {
        lanelet.lanelet_id: shapely.make_valid(shapely.Polygon(_build_outline(path, lanelet)))
        for lanelet in network.lanelets
    }
    tree = shapely.STRtree(list(areas.values()))
    exits = {lanelet.lanelet_id: tuple(lanelet.successor) for lanelet in network.lanelets}
    incomings = [incoming for intersection in network.intersections for incoming in intersection.incomings]
    reached = set[int]().union(
        *(incoming.outgoing_right | incoming.outgoing_straight | incoming.outgoing_left for incoming in incomings)
    )
    queue = list(reached)
    while queue:
        for after in exits.get(queue.pop(), ()):
            if after in areas and after not in reached and _overlaps_others(areas[after], tree):
                reached.add(after)
                queue.append(after)
    return frozenset(reached)


def _overlaps_others(area: Any, tree: shapely.STRtree) -> bool:
    near = tree.geometries.take(tree.query(area))
    return float(shapely.area(shapely.intersection(area, near)).sum() - area.area) > MIN_OVERLAP_M2


def _build_lane(path: Path, lanelet: Any, signs: Mapping[int, Any], inside: frozenset[int]) -> MapLane:
    types = _get_types(lanelet)
    left, right = ("adj_left", "left_vertices"), ("adj_right", "right_vertices")
    return MapLane(
        id=str(lanelet.lanelet_id),
        kind=next((kind for name, kind in LANE_KIND_BY_TYPE.items() if name in types), LaneKind.DRIVING),
        centre=_parse_line(path, lanelet, "center_vertices"),
        left=_parse_line(path, lanelet, left[1]),
        right=_parse_line(path, lanelet, right[1]),
        entries=tuple(str(id_) for id_ in lanelet.predecessor),
        exits=tuple(str(id_) for id_ in lanelet.successor),
        left_neighbour=_find_neighbour(lanelet, left[0]),
        right_neighbour=_find_neighbour(lanelet, right[0]),
        speed_limit=_find_speed_limit(path, lanelet, signs),
        junction=lanelet.lanelet_id in inside or "intersection" in types,
    )


def _parse_line(path: Path, lanelet: Any, name: str) -> Float:
    where = f"{path}: lanelet {lanelet.lanelet_id}"
    line = parse_points(where, getattr(lanelet, name))
    if len(line) < 2:
        raise InputError(f"{where}: expected at least two distinct points, found {len(line)}")
    return line


def _find_neighbour(lanelet: Any, side: str) -> str:
    """Return the adjacent lane if it has the same direction."""
    return str(getattr(lanelet, side)) if getattr(lanelet, f"{side}_same_direction") else ""


def _find_speed_limit(path: Path, lanelet: Any, signs: Mapping[int, Any]) -> float:
    """Return the lowest limit of its signs [m/s]; NaN if there is none."""
    values = [
        _parse_speed(f"{path}: trafficSign {id_}", element.additional_values[0])
        for id_ in lanelet.traffic_signs
        if id_ in signs
        for element in signs[id_].traffic_sign_elements
        if element.traffic_sign_element_id.name == "MAX_SPEED" and element.additional_values
    ]
    return min(values, default=math.nan)


def _parse_speed(where: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise InputError(f"{where}: additionalValue: expected a positive speed, found {text!r}")
    return value


def _build_outline(path: Path, lanelet: Any) -> Float:
    return np.concatenate(
        (_parse_line(path, lanelet, "right_vertices"), _parse_line(path, lanelet, "left_vertices")[::-1])
    )


def _build_stop_lines(lanelet: Any, signs: Mapping[int, Any]) -> Iterator[StopLine]:
    """Yield the drawn stop line, or one at the end of a lane with a stop or yield sign."""
    meaning = _find_sign(lanelet, signs)
    if lanelet.stop_line is not None:
        ends = lanelet.stop_line.start, lanelet.stop_line.end
    elif meaning in SIGN_BY_NAME.values():
        ends = lanelet.left_vertices[-1], lanelet.right_vertices[-1]
    else:
        return
    yield StopLine(
        np.array([np.asarray(end, dtype=np.float64)[:2] for end in ends]), (str(lanelet.lanelet_id),), meaning
    )


def _find_sign(lanelet: Any, signs: Mapping[int, Any]) -> str:
    if lanelet.traffic_lights:
        return "signal"
    elements = (
        element for id_ in lanelet.traffic_signs if id_ in signs for element in signs[id_].traffic_sign_elements
    )
    signs_here = {SIGN_BY_NAME.get(element.traffic_sign_element_id.name, "") for element in elements} - {""}
    return min(signs_here, default="")


def _build_signals(lanelets: list[Any]) -> dict[str, tuple[str, ...]]:
    lanes: defaultdict[str, tuple[str, ...]] = defaultdict(tuple)
    for lanelet in lanelets:
        for light in sorted(lanelet.traffic_lights):
            lanes[str(light)] += (str(lanelet.lanelet_id),)
    return dict(lanes)
