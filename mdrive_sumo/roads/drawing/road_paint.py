"""Painted lines of a network as areas on the ground, for pictures and cameras."""

from collections.abc import Iterator

import numpy as np
import shapely
from shapely.ops import substring

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.roads.drawing.map_geometry import MapGeometry

DASH_M, DASH_PERIOD_M = 3.0, 7.5
"""[m] As in the replay."""


def build_road_paint(geometry: MapGeometry, line_m: float, stop_line_m: float) -> list[shapely.Polygon]:
    """Return crosswalk stripes, lane markings and stop lines. line_m, stop_line_m: widths [m] of the last two."""
    return [
        *geometry.stripes,
        *(part for solid in geometry.markings.solid for part in widen_line(solid, line_m)),
        *(part for dashed in geometry.markings.dashed for dash in _cut(dashed) for part in widen_line(dash, line_m)),
        *(
            part
            for mark in (*geometry.stop_signs, *geometry.light_stops)
            for part in widen_line(mark.line, stop_line_m)
        ),
    ]


def widen_line(xy: Float, width: float) -> list[shapely.Polygon]:
    """Return a line (K, 2) as areas of a width [m]."""
    shape = shapely.LineString(xy).buffer(width / 2, cap_style="flat", join_style="mitre", mitre_limit=2.0)
    return [part for part in shapely.get_parts(shape).tolist() if isinstance(part, shapely.Polygon)]


def _cut(xy: Float) -> Iterator[Float]:
    """Yield the dashes of a line (K, 2)."""
    line = shapely.LineString(xy)
    for start in np.arange(0.0, line.length, DASH_PERIOD_M).tolist():
        dash = substring(line, start, min(start + DASH_M, line.length))
        if isinstance(dash, shapely.LineString):
            yield shapely.get_coordinates(dash)
