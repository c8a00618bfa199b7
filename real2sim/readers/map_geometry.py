"""Geometry of maps that several readers need: centre lines, lines across lanes, drivable areas."""

from collections.abc import Iterable

import numpy as np
import shapely
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Float, Polyline, build_polyline
from real2sim.hd_map import MapArea
from real2sim.recording import RecordedTrack

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


def compute_centreline(left: Float, right: Float) -> Float:
    """Return the line (N, 2) half-way between two boundaries of one direction, points about 2 m apart."""
    sides = build_polyline(left), build_polyline(right)
    count = max(2, len(left), len(right), round(max(side.length for side in sides) / 2.0) + 1)
    share = np.linspace(0.0, 1.0, count)
    points = [
        np.column_stack([np.interp(share * side.length, side.s, side.xy[:, axis]) for axis in (0, 1)]) for side in sides
    ]
    return (points[0] + points[1]) / 2


def build_cross_line(line: Polyline, s: float, width: float) -> Float:
    """Return a line (2, 2) [m] across a lane at arc length s [m], from left to right."""
    yaw, middle = line.yaw_at(s), np.array(line.at(s))
    left = np.array((-np.sin(yaw), np.cos(yaw))) * width / 2
    return np.stack((middle + left, middle - left))


def shift_ahead(track: RecordedTrack, distance: float) -> RecordedTrack:
    """Shift every pose of a track `distance` [m] ahead, e.g. from the rear axle to the box centre."""
    return track.replace_columns(x=track.x + distance * np.cos(track.yaw), y=track.y + distance * np.sin(track.yaw))
