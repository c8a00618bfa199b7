"""Find crosswalks that a map draws as pairs of marked lines instead of lanelets, as INTERACTION's maps do."""

import numpy as np
import shapely

from mdrive_sumo.core.geometry import Float
from real2sim.readers.osm_file import OsmFile

WIDTHS_M = (1.5, 8.0)
"""[m] Distance between the two lines of a crosswalk."""
MIN_LENGTH_RATIO = 0.5
"""Minimum length of the shorter line relative to the longer one."""


def find_marked_crosswalks(osm: OsmFile) -> tuple[Float, ...]:
    """Return polygons (N, 2) [m] between pedestrian markings that are mutually nearest and similar in length."""
    marked = [osm.build_line(way) for way in osm.ways.values() if way.tags.get("type") == "pedestrian_marking"]
    if len(marked) < 2:
        return ()
    lines = shapely.get_parts(shapely.line_merge(shapely.MultiLineString(marked)))
    apart = np.array([[one.hausdorff_distance(other) for other in lines] for one in lines])
    np.fill_diagonal(apart, np.inf)
    nearest = apart.argmin(axis=1)
    pairs = ((one, int(other)) for one, other in enumerate(nearest) if nearest[other] == one < other)
    return tuple(_build_polygon(lines[one], lines[other]) for one, other in pairs if _is_pair(lines[one], lines[other]))


def _is_pair(one: shapely.LineString, other: shapely.LineString) -> bool:
    alike = min(one.length, other.length) >= MIN_LENGTH_RATIO * max(one.length, other.length)
    return alike and WIDTHS_M[0] <= one.interpolate(0.5, normalized=True).distance(other) <= WIDTHS_M[1]


def _build_polygon(one: shapely.LineString, other: shapely.LineString) -> Float:
    left, right = (np.asarray(line.coords, dtype=np.float64)[:, :2] for line in (one, other))
    return build_outline(
        left, right if measure_end_gap(left, right) <= measure_end_gap(left, right[::-1]) else right[::-1]
    )


def build_outline(left: Float, right: Float) -> Float:
    """Return the polygon (N, 2) [m] between two lines with the same direction."""
    return np.concatenate((right, left[::-1]))


def measure_end_gap(one: Float, other: Float) -> float:
    """Return the sum of the gaps [m] between both starts and both ends."""
    return float(np.hypot(*(one[[0, -1]] - other[[0, -1]]).T).sum())
