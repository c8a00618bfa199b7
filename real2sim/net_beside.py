"""Which strips lie side by side in the same direction, and which cross each other."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import shapely

from mdrive_sumo.geometry import Float
from real2sim.net_lanes import Strip, shapes, yaw_gap

APART_M = (1.8, 5.5)
"""Lateral distance [m] between the centre lines of true neighbours."""
PARALLEL = np.radians(20)
STEADY_M = 1.5
"""How much the distance between neighbours may vary: more, and they part."""
SHARED_M = 8.0
"""Shortest stretch that counts as side by side."""
STEP_M = 1.0
CROSSING_YAW = np.radians(12)
CROSSING_INSIDE_M = 1.5
"""Lines that touch nearer than this to the ends of both only meet there."""


@dataclass(frozen=True)
class Beside:
    """Strip `other` lies beside `strip` from arc length `begin` to `end` [m] of it."""

    strip: str
    other: str
    begin: float
    end: float
    offset: float
    """Mean signed distance [m]; positive: `other` lies to the left."""


def find_beside(strips: Mapping[str, Strip]) -> list[Beside]:
    """All ordered pairs of neighbours."""
    values = list(strips.values())
    drawn = shapes(strip.line for strip in values)
    pairs = shapely.STRtree(drawn).query(drawn, predicate="dwithin", distance=APART_M[1])
    besides = (_beside(values[i], values[j], drawn[j]) for i, j in sorted(zip(*pairs, strict=True)) if i != j)
    return [beside for beside in besides if beside is not None]


def _beside(strip: Strip, other: Strip, shape: shapely.LineString) -> Beside | None:
    stations = strip.line.stations(STEP_M)
    offset = _offsets(strip, other, shape, stations)
    size = np.abs(offset)
    good = (size >= APART_M[0]) & (size <= APART_M[1])
    if good.sum() * STEP_M < min(SHARED_M, 0.6 * strip.line.length):
        return None
    middle = float(np.median(offset[good]))
    good &= np.abs(offset - middle) <= STEADY_M
    rows = _longest_run(good)
    begin, end = float(stations[rows[0]]), float(stations[rows[-1]])
    if end - begin < min(SHARED_M, 0.6 * strip.line.length):
        return None
    return Beside(strip.id, other.id, begin, end, middle)


def _offsets(strip: Strip, other: Strip, shape: shapely.LineString, stations: Float) -> Float:
    """Signed distance (M,) [m] to the other strip at stations of the first; infinite where it is not parallel there."""
    xy = np.column_stack([np.interp(stations, strip.line.s, strip.line.xy[:, axis]) for axis in (0, 1)])
    at = shapely.line_locate_point(shape, shapely.points(xy))
    foot = np.column_stack([np.interp(at, other.line.s, other.line.xy[:, axis]) for axis in (0, 1)])
    yaw = strip.line.yaws_at(stations)
    gap = foot - xy
    ahead = np.abs(gap[:, 0] * np.cos(yaw) + gap[:, 1] * np.sin(yaw))
    left = gap[:, 1] * np.cos(yaw) - gap[:, 0] * np.sin(yaw)
    turn = np.abs(np.angle(np.exp(1j * (other.line.yaws_at(at) - yaw))))
    return np.where((turn <= PARALLEL) & (ahead <= 1.0), left, np.inf)


def _longest_run(good: np.ndarray) -> range:
    best, begin = range(0, 1), 0
    for i, here in enumerate(good):
        if not here:
            begin = i + 1
        elif i + 1 - begin > len(best):
            best = range(begin, i + 1)
    return best


def find_crossings(strips: Mapping[str, Strip]) -> dict[tuple[str, str], list[tuple[float, float]]]:
    """Pairs (in order of id) whose centre lines cross, with the arc lengths [m] on both where they do."""
    values = sorted(strips.values(), key=lambda strip: strip.id)
    drawn = shapes(strip.line for strip in values)
    found: dict[tuple[str, str], list[tuple[float, float]]] = defaultdict(list)
    for i, j in zip(*shapely.STRtree(drawn).query(drawn, predicate="intersects"), strict=True):
        if i >= j:
            continue
        for point in shapely.get_parts(shapely.intersection(drawn[i], drawn[j])):
            at = tuple(float(shapely.line_locate_point(drawn[k], shapely.centroid(point))) for k in (i, j))
            if _inside(values[i], values[j], at[0], at[1]):
                found[values[i].id, values[j].id].append((at[0], at[1]))
    return dict(found)


def _inside(first: Strip, second: Strip, a: float, b: float) -> bool:
    inner = (min(a, first.line.length - a), min(b, second.line.length - b))
    turn = yaw_gap(first.line.yaw_at(a), second.line.yaw_at(b))
    return min(inner) > CROSSING_INSIDE_M / 3 and max(inner) > CROSSING_INSIDE_M and turn > CROSSING_YAW
