"""Lane boundaries of ScenarioNet maps, and checked access to map features."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mdrive_sumo.core.errors import InputError
from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from real2sim.readers.checked_arrays import describe_value, is_empty, parse_all_points, parse_numbers, parse_points

MapFeature = Mapping[str, Any]


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
    known = sides[(sides > 0).all(1)]
    return float(np.median(known.sum(1))) if len(known) else float("nan")


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
    for one in read_list(where, feature, name):
        if not isinstance(one, dict):
            raise InputError(f"{where}.{name}: expected dicts, found {type(one).__name__}")
        line = features.get(str(one.get("boundary_feature_id")), {}).get("polyline")
        if not is_empty(line):
            rows = [int(read_finite(f"{where}.{name}", one, f"lane_{end}_index")) for end in ("start", "end")]
            pieces.append(_clip_line(parse_points(f"{where}.{name}", line), centre[np.clip(rows, 0, len(centre) - 1)]))
    return np.concatenate(pieces)


def _clip_line(line: Float, ends: Float) -> Float:
    start, end = (int(np.argmin(((line - point) ** 2).sum(1))) for point in ends)
    return line[start : end + 1] if start <= end else line[end : start + 1][::-1]
