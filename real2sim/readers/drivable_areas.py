"""Build the drivable areas of a map from outlines."""

from collections.abc import Iterable

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Float
from real2sim.hd_map import MapArea

CLOSED_M = 0.1
"""[m] Lines whose ends are this close are rings."""


def is_ring(line: Float) -> bool:
    """Return whether a line (N, 2) [m] encloses an area."""
    return len(line) > 3 and float(np.hypot(*(line[0] - line[-1]))) <= CLOSED_M


def build_nested_areas(rings: Iterable[Float]) -> tuple[MapArea, ...]:
    """Return the areas within rings (N, 2) [m]; a ring within another one is a hole, a ring in a hole an island."""
    lines = [shapely.LineString(np.concatenate((ring, ring[:1]))) for ring in rings if len(ring) > 2]
    return split_areas(shapely.build_area(shapely.union_all(lines))) if lines else ()


def build_separate_areas(outlines: Iterable[Float]) -> tuple[MapArea, ...]:
    """Return the areas within outlines (N, 2) [m], which may overlap and may cross themselves."""
    return tuple(area for outline in outlines for area in build_nested_areas([outline]))


def split_areas(shape: BaseGeometry) -> tuple[MapArea, ...]:
    """Return the polygons of a shape."""
    return tuple(
        MapArea(_get_corners(part.exterior), tuple(_get_corners(ring) for ring in part.interiors))
        for part in shapely.get_parts(shape).tolist()
        if isinstance(part, shapely.Polygon) and not part.is_empty
    )


def _get_corners(ring: shapely.LinearRing) -> Float:
    return shapely.get_coordinates(ring)[:-1]
