"""Compute the stripes of pedestrian crossings for pictures."""

from collections.abc import Iterator, Sequence

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Float, build_polyline
from mdrive_sumo.roads import Lane

PERIOD_M, STRIPE_M = 1.0, 0.5
"""[m] Distance between the middles of stripes, and their width."""
MIN_SHARE = 0.4
"""Stripes with a smaller share on asphalt are left out: they would lie on the kerb or beside the road."""


def build_crossing_stripes(line: Float, width: float) -> list[shapely.Polygon]:
    """Return the stripes of a crossing with a centre line (N, 2) and a width [m]."""
    centre = build_polyline(line)
    margin = (centre.length % PERIOD_M + PERIOD_M - STRIPE_M) / 2
    starts = np.arange(margin, centre.length - STRIPE_M + 1e-6, PERIOD_M)
    return [
        _build_stripe(np.array(centre.at(s + STRIPE_M / 2)), centre.yaw_at(s + STRIPE_M / 2), width) for s in starts
    ]


def _build_stripe(middle: Float, yaw: float, width: float) -> shapely.Polygon:
    ahead, left = np.array((np.cos(yaw), np.sin(yaw))), np.array((-np.sin(yaw), np.cos(yaw)))
    half, side = ahead * STRIPE_M / 2, left * width / 2
    return shapely.Polygon((middle + half + side, middle - half + side, middle - half - side, middle + half - side))


def find_walking_line(outline: Float, lanes: Sequence[Lane]) -> tuple[Float, float] | None:
    """Return centre line (2, 2) and width [m] of the rectangle around a crosswalk (N, 2); None if it has no area.

    People walk across the lanes below the crosswalk; without a lane, along its longer side.
    """
    corners = shapely.get_coordinates(shapely.minimum_rotated_rectangle(shapely.MultiPoint(outline)))
    if len(corners) < 4:
        return None
    pairs = [((corners[0] + corners[3]) / 2, (corners[1] + corners[2]) / 2)]
    pairs.append(((corners[0] + corners[1]) / 2, (corners[2] + corners[3]) / 2))
    lines = [np.array(pair) for pair in pairs]
    lengths = [float(np.hypot(*(line[1] - line[0]))) for line in lines]
    along = [_measure_traffic_along(outline, line, lanes) for line in lines]
    chosen = int(np.argmin(along)) if abs(along[0] - along[1]) > 0.1 * max(along) else int(np.argmax(lengths))
    return (lines[chosen], lengths[1 - chosen]) if min(lengths) > 0 else None


def _measure_traffic_along(outline: Float, line: Float, lanes: Sequence[Lane]) -> float:
    """Return the length [m] of lanes within a crosswalk, projected onto the direction of a line (2, 2)."""
    ahead = (line[1] - line[0]) / max(float(np.hypot(*(line[1] - line[0]))), 1e-9)
    area = shapely.MultiPoint(outline).convex_hull
    steps = [np.diff(xy, axis=0) @ ahead for lane in lanes for xy in _clip_line(lane.centre.xy, area)]
    return float(np.abs(np.concatenate(steps)).sum()) if steps else 0.0


def _clip_line(xy: Float, area: BaseGeometry) -> Iterator[Float]:
    for part in shapely.get_parts(shapely.intersection(shapely.LineString(xy), area)).tolist():
        if isinstance(part, shapely.LineString):
            yield shapely.get_coordinates(part)


def clip_stripes(stripes: Sequence[shapely.Polygon], asphalt: BaseGeometry) -> Iterator[shapely.Polygon]:
    """Yield the parts of stripes that lie on asphalt, without stripes of which little does."""
    shapely.prepare(asphalt)
    for stripe in stripes:
        part = stripe if asphalt.contains(stripe) else shapely.intersection(stripe, asphalt)
        if part.area >= MIN_SHARE * stripe.area:
            yield from (one for one in shapely.get_parts(part).tolist() if isinstance(one, shapely.Polygon))
