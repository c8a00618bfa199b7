"""Read vector maps of V2XPnP: a pickle of plain classes, loaded without executing its contents.

Classes of the original module become containers of their fields; all other names in the pickle are refused
(`safe_pickle`). The map has centre lines and one list of boundary points per lane, but no widths, limits or neighbours;
the order of a lane's points is not its direction of travel.
"""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import shapely

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Polyline
from real2sim.hd_map import HdMap, LaneKind, MapLane
from real2sim.polylines import PolylineIndex
from real2sim.readers.input_checks import describe_value, parse_points
from real2sim.readers.safe_pickle import NUMPY_GLOBALS, Constructor, load_pickle

MODULE = "opencood.data_utils.datasets.map.map_types"
"""Module of the classes in the dataset's pickles."""
LANE_KINDS: Mapping[int, LaneKind] = MappingProxyType(
    {1: LaneKind.DRIVING, 2: LaneKind.SIDEWALK, 3: LaneKind.SHOULDER, 4: LaneKind.PARKING}
)
"""The format's LaneType; 0 is unknown."""
BESIDE_M = 2.0
"""[m] Most boundary points are nearer to the centre line; all are projected, those nearer faster."""
ON_CENTRE_M = 0.05
"""[m] A boundary point this close to the centre line is on neither side."""


class PickledFields:
    """An object of the pickle, reduced to its fields."""

    fields: Mapping[Any, Any] = MappingProxyType({})

    def __new__(cls, *_: object) -> "PickledFields":
        """Ignore the constructor arguments in the pickle."""
        return super().__new__(cls)

    def __setstate__(self, state: object) -> None:
        """Store the fields of a plain or a slotted class."""
        if isinstance(state, tuple):
            state = {name: value for part in state if isinstance(part, dict) for name, value in part.items()}
        if isinstance(state, dict):
            self.fields = state


def _build_dict(items: Iterable[tuple[Any, Any]] = ()) -> dict[Any, Any]:
    return dict(items)


def _read_lane_type(number: object) -> int:
    """Return any number; an enumeration would refuse unknown ones."""
    if not isinstance(number, int):
        raise ValueError(f"expected a number for LaneType, found {type(number).__name__}")
    return number


_CLASS_NAMES = (
    "Map",
    "Lane",
    "MapPoint",
    "Crosswalk",
    "RoadLine",
    "WalkButton",
    "DynamicState",
    "TrafficSignalLaneState",
)
_CLASS_BY_NAME = {name: type(name, (PickledFields,), {}) for name in _CLASS_NAMES}
_ALLOWED_GLOBALS = {
    **NUMPY_GLOBALS,
    ("collections", "OrderedDict"): Constructor(_build_dict),
    (MODULE, "LaneType"): Constructor(_read_lane_type),
    **{(MODULE, name): bag for name, bag in _CLASS_BY_NAME.items()},
}


def read_vector_map(path: Path) -> tuple[HdMap, tuple[str, ...]]:
    """Read a vector map [m, frame of the logs], with notes on what was skipped.

    Raises InputError if it is not such a pickle, names another class, or has no lane.
    """
    root: Any = load_pickle(path, _ALLOWED_GLOBALS)
    if not _is_instance(root, "Map"):
        raise InputError(f"{path}: expected a pickled Map of {MODULE}, found {type(root).__name__}")
    features = _parse_list(f"{path}: map_features", root.fields.get("map_features"))
    skipped_counts: Counter[str] = Counter()
    lanes: dict[str, MapLane] = {}
    for lane in _build_lanes(path, features, skipped_counts):
        skipped_counts["lanes with the id of another one"] += lane.id in lanes
        lanes.setdefault(lane.id, lane)
    if not lanes:
        raise InputError(f"{path}: expected lanes, found none among {len(features)} map features")
    hd_map = HdMap(
        lanes=lanes,
        crosswalks=tuple(_build_crosswalks(path, features, skipped_counts)),
        signals=_build_signals(path, root.fields.get("dynamic_states"), features, skipped_counts),
    )
    return hd_map, tuple(f"{path.name}: skipped {count} {what}" for what, count in sorted((+skipped_counts).items()))


def _is_instance(value: object, name: str) -> bool:
    return isinstance(value, _CLASS_BY_NAME[name])


def _get_field(value: object, name: str) -> Any:
    return value.fields.get(name) if isinstance(value, PickledFields) else None


def _parse_list(where: str, raw: Any) -> list[Any]:
    if raw is None:
        return []
    if not isinstance(raw, list | tuple | np.ndarray):
        raise InputError(f"{where}: expected a list, found {type(raw).__name__}")
    return list(raw)


def _parse_integer(where: str, raw: Any) -> int:
    if not isinstance(raw, int | np.integer):
        raise InputError(f"{where}: expected a whole number, found {describe_value(raw)}")
    return int(raw)


def _parse_map_points(where: str, raw: Any) -> Float:
    """Return (N, 2) of a list of MapPoints or an array with columns x, y, without duplicates; N may be 0."""
    line = _parse_list(where, raw)
    if not line:
        return np.zeros((0, 2))
    return parse_points(
        where, [(p.fields.get("x"), p.fields.get("y")) if isinstance(p, PickledFields) else p for p in line]
    )


def _parse_lane_id(path: Path, fields: Mapping[Any, Any]) -> tuple[int, int]:
    road, lane = (_parse_integer(f"{path}: lane: {name}", fields.get(name)) for name in ("road_id", "lane_id"))
    return road, lane


def _build_lanes(path: Path, features: list[Any], skipped_counts: Counter[str]) -> Iterator[MapLane]:
    for feature in features:
        if not _is_instance(feature, "Lane"):
            continue
        road, lane = _parse_lane_id(path, feature.fields)
        where = f"{path}: lane {road}_{lane}"
        centre = _parse_map_points(f"{where}: polyline", feature.fields.get("polyline"))
        kind = LANE_KINDS.get(_parse_integer(f"{where}: type", feature.fields.get("type")))
        if len(centre) < 2 or kind is None:
            skipped_counts["lanes of unknown type" if kind is None else "lanes with less than 2 points"] += 1
            continue
        left, right = _split_boundary(centre, _parse_map_points(f"{where}: boundary", feature.fields.get("boundary")))
        yield MapLane(
            id=f"{road}_{lane}",
            kind=kind,
            centre=centre,
            left=left,
            right=right,
            entries=tuple(map(str, _parse_list(f"{where}: entry_lanes", feature.fields.get("entry_lanes")))),
            exits=tuple(map(str, _parse_list(f"{where}: exit_lanes", feature.fields.get("exit_lanes")))),
            group=str(road),
            directed=False,
        )


def _split_boundary(centre: Float, boundary: Float) -> tuple[Float, Float]:
    """Split boundary points (N, 2) into those left and right of the centre line, sorted along it."""
    if not len(boundary):
        return boundary, boundary
    station, foot = _locate_on_line(centre, boundary)
    lengths = np.hypot(*np.diff(centre, axis=0).T)
    segment = np.clip(np.searchsorted(np.cumsum(lengths), station), 0, len(lengths) - 1)
    ahead = np.diff(centre, axis=0)[segment] / lengths[segment, None]
    gap = boundary - foot
    along = station + (ahead * gap).sum(1)  # extends beyond the ends, where `station` is clamped
    aside = ahead[:, 0] * gap[:, 1] - ahead[:, 1] * gap[:, 0]
    order = np.argsort(along, kind="stable")
    left, right = (boundary[order[side[order]]] for side in (aside > ON_CENTRE_M, aside < -ON_CENTRE_M))
    return left if len(left) > 1 else left[:0], right if len(right) > 1 else right[:0]


def _locate_on_line(centre: Float, points: Float) -> tuple[Float, Float]:
    """Return arc lengths (N,) [m] and positions (N, 2) [m] of the projections of points (N, 2) onto a line."""
    station, foot = np.empty(len(points)), np.empty((len(points), 2))
    near, _, station_near, foot_near = PolylineIndex((Polyline(centre),)).locate_points(points, BESIDE_M)
    station[near], foot[near] = station_near, foot_near
    far = np.setdiff1d(np.arange(len(points)), near)
    if len(far):
        line = shapely.LineString(centre)
        station[far] = shapely.line_locate_point(line, shapely.points(points[far]))
        foot[far] = shapely.get_coordinates(shapely.line_interpolate_point(line, station[far]))
    return station, foot


def _build_crosswalks(path: Path, features: list[Any], skipped_counts: Counter[str]) -> Iterator[Float]:
    for number, feature in enumerate(features):
        if _is_instance(feature, "Crosswalk"):
            polygon = _parse_map_points(f"{path}: crosswalk {number}: polygon", feature.fields.get("polygon"))
            if len(polygon) > 2:
                yield polygon
            else:
                skipped_counts["crosswalks with less than 3 points"] += 1


def _build_signals(
    path: Path, states: Any, features: list[Any], skipped_counts: Counter[str]
) -> Mapping[str, tuple[str, ...]]:
    """Return one traffic light per lane with any state; the format refers to lanes by list index."""
    signals: dict[str, tuple[str, ...]] = {}
    for state in _parse_list(f"{path}: dynamic_states", states):
        for lane_state in _parse_list(f"{path}: lane_states", _get_field(state, "lane_states")):
            number = _parse_integer(f"{path}: lane_states: lane", _get_field(lane_state, "lane"))
            feature: Any = features[number] if 0 <= number < len(features) else None
            if _is_instance(feature, "Lane"):
                name = "{}_{}".format(*_parse_lane_id(path, feature.fields))
                signals[name] = (name,)
            else:
                skipped_counts["signal states of unknown lanes"] += 1
    return signals
