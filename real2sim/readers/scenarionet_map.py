"""Build the map of a ScenarioNet description with the lanes of nuScenes, Waymo or nuPlan."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from real2sim.hd_map import HdMap, LaneKind, MapArea, MapLane, StopLine
from real2sim.readers.input_checks import describe_value, is_empty, parse_all_points, parse_numbers, parse_points
from real2sim.readers.map_geometry import build_cross_line, build_nested_areas, build_separate_areas, is_ring

DEFAULT_LINE_M = 3.5
"""[m] Length of a stop line across a lane of unknown width."""
ENDS_MEET_M = 0.1
"""[m] Lane ends this close are connected: in nuScenes they agree to 1e-11 m or not at all."""
ENDS_ALIGNED_RAD = np.radians(45)
"""A lane that continues another one differs by less in direction; one that crosses or turns back by more."""
MPS_PER_MPH = 0.44704
MAX_LIMIT_MPS = 50.0
"""[m/s] Higher limits stand for none: MetaDrive gives its lanes 1000 km/h."""

MapFeatures = Mapping[str, Mapping[str, Any]]
Notes = tuple[str, ...]
MapFeature = Mapping[str, Any]


def build_scenarionet_map(path: Path, description: Mapping[str, Any], dataset: str) -> tuple[HdMap, Notes]:
    """Build the map, with notes on what was skipped or assumed; raise InputError."""
    features, empty_notes = _skip_empty_features(_read_features(path, description))
    lanes, lane_notes = _build_lanes(path, features, dataset)
    stops, stop_notes = _build_stop_signs(path, features, lanes)
    lines, signals, light_notes = _build_traffic_lights(
        path, _read_entries(path, description, "dynamic_map_states"), lanes, dataset
    )
    crosswalks = tuple(
        parse_points(f"{path}: map_features.{id_}", feature.get("polygon"))
        for id_, feature in features.items()
        if feature["type"] == "CROSSWALK"
    )
    hd_map = HdMap(
        lanes=lanes,
        crosswalks=crosswalks,
        stop_lines=stops + lines,
        signals=signals,
        drivable_areas=_build_drivable_areas(path, features),
    )
    return hd_map, (*empty_notes, *lane_notes, *stop_notes, *light_notes)


def _build_drivable_areas(path: Path, features: MapFeatures) -> tuple[MapArea, ...]:
    """Return Waymo's driveways, and what lies within the closed boundaries that nuScenes and nuPlan have."""
    driveways = [
        parse_points(f"{path}: map_features.{id_}", feature.get("polygon"))
        for id_, feature in features.items()
        if feature["type"] == "DRIVEWAY"
    ]
    boundaries = [
        parse_points(f"{path}: map_features.{id_}", feature.get("polyline"))
        for id_, feature in features.items()
        if id_.startswith("boundary")
    ]
    return build_separate_areas(driveways) + build_nested_areas(filter(is_ring, boundaries))


def _read_features(path: Path, description: Mapping[str, Any]) -> MapFeatures:
    features = _read_entries(path, description, "map_features")
    for id_, feature in features.items():
        if not isinstance(feature.get("type"), str):
            raise InputError(
                f"{path}: map_features.{id_}.type: expected a word, found {describe_value(feature.get('type'))}"
            )
    return features


def _skip_empty_features(features: MapFeatures) -> tuple[MapFeatures, Notes]:
    """Return the features that have points, and a note on the others: converters write lines and areas without any."""
    empty = {id_ for id_, feature in features.items() if is_empty(feature.get(_find_geometry(id_, feature)))}
    counts = Counter(features[id_]["type"] for id_ in features if id_ in empty)
    kept = {id_: feature for id_, feature in features.items() if id_ not in empty}
    return kept, tuple(f"{count} map features {type_} without any point skipped" for type_, count in counts.items())


def _find_geometry(id_: str, feature: Mapping[str, Any]) -> str:
    """Return the name of the field with the points that the map needs of a feature."""
    if feature["type"] in ("CROSSWALK", "DRIVEWAY"):
        return "polygon"
    if feature["type"] == "STOP_SIGN":
        return "position"
    return "polyline" if feature["type"].startswith("LANE_") or id_.startswith("boundary") else "type"


def _read_entries(path: Path, description: Mapping[str, Any], name: str) -> MapFeatures:
    """Return a dict of dicts with text ids: Waymo has numbers."""
    entries = description.get(name, {})
    if not isinstance(entries, dict):
        raise InputError(f"{path}: {name}: expected a dict, found {type(entries).__name__}")
    for id_, entry in entries.items():
        if not isinstance(entry, dict):
            raise InputError(f"{path}: {name}.{id_}: expected a dict, found {type(entry).__name__}")
    return {str(id_): entry for id_, entry in entries.items()}


def _build_lanes(path: Path, features: MapFeatures, dataset: str) -> tuple[dict[str, MapLane], Notes]:
    raw = {id_: feature for id_, feature in features.items() if feature["type"].startswith("LANE_")}
    read = (_build_lane(path, id_, features, dataset) for id_ in raw)
    lanes = {lane.id: lane for lane in read if lane is not None}
    if not lanes:
        raise InputError(f"{path}: map_features: expected at least one lane, found none in {len(features)} features")
    notes = [f"{len(raw) - len(lanes)} lanes without two distinct points skipped"] if len(lanes) < len(raw) else []
    if dataset == "nuscenes":
        notes.append("speed limits of the map left out: the converter writes 100 km/h on every connector of nuScenes")
    if not any(lane.entries or lane.exits for lane in lanes.values()):
        lanes = _link_touching_lanes(lanes)
        count = sum(len(lane.exits) for lane in lanes.values())
        notes.append(f"the source connects no lanes: {count} connections made where their ends coincide")
    return lanes, tuple(notes)


def _build_lane(path: Path, id_: str, features: MapFeatures, dataset: str) -> MapLane | None:
    feature, where = features[id_], f"{path}: map_features.{id_}"
    centre = parse_points(where, feature.get("polyline"))
    if len(centre) < 2:
        return None
    left, right = read_lane_boundaries(where, feature, features)
    return MapLane(
        id=id_,
        kind=LaneKind.BIKE if feature["type"] == "LANE_BIKE_LANE" else LaneKind.DRIVING,
        centre=centre,
        left=left,
        right=right,
        entries=_read_ids(where, feature, "entry_lanes"),
        exits=_read_ids(where, feature, "exit_lanes"),
        left_neighbour=_find_neighbour(where, feature, "left_neighbor", -1),
        right_neighbour=_find_neighbour(where, feature, "right_neighbor", 0),
        width=read_lane_width(where, feature),
        speed_limit=float("nan") if dataset == "nuscenes" else _read_speed_limit(where, feature),
        junction=_is_in_junction(feature, dataset),
    )


def _read_ids(where: str, feature: Mapping[str, Any], name: str) -> tuple[str, ...]:
    return tuple(str(id_) for id_ in read_list(where, feature, name))


def _find_neighbour(where: str, feature: Mapping[str, Any], name: str, nearest: int) -> str:
    """Return the nearest neighbour with the same direction.

    nuPlan lists all lanes on that side from left to right, Waymo one per stretch of the lane: the longest stretch
    counts.
    """
    neighbours = read_list(where, feature, name)
    if not neighbours:
        return ""
    if not isinstance(neighbours[nearest], dict):
        return str(neighbours[nearest])
    stretches: list[Mapping[str, Any]] = [neighbour for neighbour in neighbours if isinstance(neighbour, dict)]
    lengths = [
        read_finite(where, stretch, "self_end_index") - read_finite(where, stretch, "self_start_index")
        for stretch in stretches
    ]
    return str(stretches[int(np.argmax(lengths))].get("feature_id", ""))


def _read_speed_limit(where: str, feature: Mapping[str, Any]) -> float:
    limit = (
        read_finite(where, feature, "speed_limit_kmh") / 3.6
        or read_finite(where, feature, "speed_limit_mph") * MPS_PER_MPH
    )
    return limit if 0 < limit <= MAX_LIMIT_MPS else float("nan")


def _is_in_junction(feature: Mapping[str, Any], dataset: str) -> bool:
    """Return whether the lane is a connector: without a polygon in nuScenes, interpolated between others in Waymo."""
    if dataset == "nuscenes":
        return "polygon" not in feature
    return feature["type"] == "LANE_SURFACE_UNSTRUCTURE" or bool(feature.get("interpolating"))


def _link_touching_lanes(lanes: Mapping[str, MapLane]) -> dict[str, MapLane]:
    """Add entries and exits where one lane ends as another begins, in about the same direction."""
    ids = list(lanes)
    starts, ends = (np.array([lanes[id_].centre[row] for id_ in ids]) for row in (0, -1))
    first, last = (np.array([_compute_yaw(lanes[id_].centre, row) for id_ in ids]) for row in (0, -2))
    near = np.hypot(*(ends[:, None] - starts[None]).transpose(2, 0, 1)) <= ENDS_MEET_M
    along = np.cos(last[:, None] - first[None]) >= np.cos(ENDS_ALIGNED_RAD)
    follows = near & along & ~np.eye(len(ids), dtype=np.bool_)
    return {
        id_: replace(
            lanes[id_],
            entries=tuple(ids[j] for j in np.flatnonzero(follows[:, i])),
            exits=tuple(ids[j] for j in np.flatnonzero(follows[i])),
        )
        for i, id_ in enumerate(ids)
    }


def _compute_yaw(centre: Float, row: int) -> float:
    step = centre[row + 1 if row >= 0 else len(centre) + row + 1] - centre[row]
    return float(np.arctan2(step[1], step[0]))


def _build_stop_signs(
    path: Path, features: MapFeatures, lanes: Mapping[str, MapLane]
) -> tuple[tuple[StopLine, ...], Notes]:
    lines: list[StopLine] = []
    lost = 0
    for id_, feature in features.items():
        if feature["type"] == "STOP_SIGN":
            where = f"{path}: map_features.{id_}"
            lane_ids = [lane for lane in _read_ids(where, feature, "lane") if lane in lanes]
            lost += not lane_ids
            position = _read_position(where, feature.get("position"))
            lines += [StopLine(_build_stop_line(lanes[lane], position), (lane,), "stop") for lane in lane_ids]
    return tuple(lines), (f"{lost} stop signs of lanes that are not in the map skipped",) if lost else ()


def _build_traffic_lights(
    path: Path, lights: MapFeatures, lanes: Mapping[str, MapLane], dataset: str
) -> tuple[tuple[StopLine, ...], dict[str, tuple[str, ...]], Notes]:
    """Return stop lines of traffic lights. nuPlan's stop point is 8 m behind the line, where the connector begins."""
    lines: list[StopLine] = []
    signals: dict[str, tuple[str, ...]] = {}
    for id_, light in lights.items():
        lane = str(light.get("lane", id_))
        if lane not in lanes:
            continue
        given = light.get("stop_point")
        middle = (
            lanes[lane].centre[0] if dataset == "nuplan" or is_empty(given) else _read_position(f"{path}: {id_}", given)
        )
        signals[id_] = (lane,)
        lines.append(StopLine(_build_stop_line(lanes[lane], middle), (lane,), "signal"))
    lost = len(lights) - len(signals)
    return (
        tuple(lines),
        signals,
        (f"{lost} traffic lights of lanes that are not in the map skipped",) if lost else (),
    )


def _read_position(where: str, raw: Any) -> Float:
    return parse_points(where, [raw])[0]


def _build_stop_line(lane: MapLane, position: Float) -> Float:
    line = Polyline(lane.centre)
    s = min(max(line.project(float(position[0]), float(position[1]))[0], 0.0), line.length)
    return build_cross_line(line, s, lane.width if lane.width > 0 else DEFAULT_LINE_M)


def read_list(where: str, feature: MapFeature, name: str) -> list[Any]:
    """Return a list, tuple or array as a list, empty if it is missing; raise InputError."""
    raw = feature.get(name)
    if raw is None:
        return []
    if not isinstance(raw, list | tuple | np.ndarray) or np.ndim(raw) == 0:
        raise InputError(f"{where}.{name}: expected a list, found {type(raw).__name__}")
    return list(raw)


def read_finite(where: str, feature: MapFeature, name: str) -> float:
    """Return a finite number, which Waymo's lanes may store as text; 0 if it is missing; raise InputError."""
    raw = feature.get(name)
    try:
        value = float(0.0 if raw is None else raw)
    except (TypeError, ValueError, OverflowError):
        value = float("nan")
    if not np.isfinite(value):
        raise InputError(f"{where}.{name}: expected a finite number, found {describe_value(raw)}")
    return value


def read_lane_width(where: str, feature: MapFeature) -> float:
    """Return the width [m] from Waymo's distances (N, 2) to both sides, 0 where unknown; NaN without any."""
    sides = parse_numbers(f"{where}.width", () if feature.get("width") is None else feature["width"])
    if sides.ndim != 2 or sides.shape[1] != 2:
        return float("nan")
    both_known = sides[(sides > 0).all(1)]
    return float(np.median(both_known.sum(1))) if len(both_known) else float("nan")


def read_lane_boundaries(where: str, feature: MapFeature, features: Mapping[str, MapFeature]) -> tuple[Float, Float]:
    """Return left and right boundaries from the lane polygon (nuScenes, nuPlan) or road lines (Waymo)."""
    if not is_empty(feature.get("polygon")):
        ring, line = (
            parse_points(f"{where}.polygon", feature["polygon"]),
            build_polyline(parse_points(where, feature["polyline"])),
        )
        return _select_side(ring, line, 1.0), _select_side(ring, line, -1.0)
    left, right = (_read_boundary(where, feature, f"{side}_boundaries", features) for side in ("left", "right"))
    return left, right


def _select_side(ring: Float, line: Polyline, side: float) -> Float:
    """Return the corners of a ring on one side of a centre line, in its order; the ring may be closed."""
    corners = ring[:-1] if len(ring) > 1 and np.allclose(ring[0], ring[-1]) else ring
    stations = [(s, i) for i, (x, y) in enumerate(corners) for s, d in (line.project(x, y),) if side * d > 0]
    return corners[[i for _, i in sorted(stations)]].reshape(-1, 2)


def _read_boundary(where: str, feature: MapFeature, name: str, features: Mapping[str, MapFeature]) -> Float:
    """Return the parts of road lines along the stretches of the lane that they bound."""
    centre = parse_all_points(where, feature["polyline"])
    pieces = [np.zeros((0, 2))]
    for item in read_list(where, feature, name):
        if not isinstance(item, dict):
            raise InputError(f"{where}.{name}: expected dicts, found {type(item).__name__}")
        line = features.get(str(item.get("boundary_feature_id")), {}).get("polyline")
        if not is_empty(line):
            rows = [int(read_finite(f"{where}.{name}", item, f"lane_{end}_index")) for end in ("start", "end")]
            pieces.append(_clip_line(parse_points(f"{where}.{name}", line), centre[np.clip(rows, 0, len(centre) - 1)]))
    return np.concatenate(pieces)


def _clip_line(line: Float, ends: Float) -> Float:
    start, end = (int(np.argmin(((line - point) ** 2).sum(1))) for point in ends)
    return line[start : end + 1] if start <= end else line[end : start + 1][::-1]
