"""The ground of a picture: the map's geometry and the routes as coloured areas, from bottom to top."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import cycle

import numpy as np
import shapely
from shapely.ops import substring

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.report.map_geometry import MapGeometry, StopMark
from mdrive_sumo.report.palette import CAV_COLOURS, LIGHT
from mdrive_sumo.report.render.canvas import fade
from mdrive_sumo.report.render.rings import Rings, build_rings
from mdrive_sumo.scenario.scenario import Ego

LINE_M, STOP_LINE_M, ROUTE_M = 0.15, 0.4, 0.35
"""[m] Least widths of markings, stop lines and routes on the ground."""
LINE_PX, STOP_LINE_PX, ROUTE_PX = 1.1, 2.0, 2.0
"""[px] Least widths on a picture from above."""
DASH_M, DASH_PERIOD_M = 3.0, 7.5
"""[m] As in the replay."""
ROUTE_OPACITY = 0.45
GOAL_M = 1.2
"""[m] Radius of the disc at the end of a route."""


@dataclass(frozen=True, slots=True)
class GroundLayer:
    """Areas of one colour on the ground."""

    colour: str
    areas: Rings


def build_ground_layers(geometry: MapGeometry, metres_per_px: float = 0.0) -> list[GroundLayer]:
    """Return the layers of a map from bottom to top, without buildings. metres_per_px: of a picture from above."""
    line = max(LINE_M, LINE_PX * metres_per_px)
    stop = max(STOP_LINE_M, STOP_LINE_PX * metres_per_px)
    marks: tuple[StopMark, ...] = (*geometry.stop_signs, *geometry.light_stops)
    paint = [
        *geometry.stripes,
        *(part for solid in geometry.markings.solid for part in _widen(solid, line)),
        *(part for dashed in geometry.markings.dashed for dash in _cut(dashed) for part in _widen(dash, line)),
        *(part for mark in marks for part in _widen(mark.line, stop)),
    ]
    layers = [("footway", geometry.pavements), ("apron", geometry.aprons), ("road", geometry.asphalt), ("line", paint)]
    return [GroundLayer(LIGHT[name], build_rings(shapes)) for name, shapes in layers]


def build_route_layers(egos: Sequence[Ego], metres_per_px: float = 0.0) -> list[GroundLayer]:
    """Return the routes of CAVs with discs at their goals."""
    width = max(ROUTE_M, ROUTE_PX * metres_per_px)
    return [
        GroundLayer(
            fade(colour, ROUTE_OPACITY),
            build_rings(_build_route(ego.xy, width)),
        )
        for ego, colour in zip(egos, cycle(CAV_COLOURS))
    ]


def _build_route(xy: Float, width: float) -> list[shapely.Polygon]:
    disc = shapely.Point(xy[-1]).buffer(max(GOAL_M, 2 * width), quad_segs=6)
    whole = shapely.union_all([*_widen(xy, width), disc])
    return [part for part in shapely.get_parts(whole).tolist() if isinstance(part, shapely.Polygon)]


def _widen(xy: Float, width: float) -> list[shapely.Polygon]:
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
