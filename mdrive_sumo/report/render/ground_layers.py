"""The ground of a picture: the map's geometry and the routes as coloured areas, from bottom to top."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import cycle

import shapely

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.report.palette import CAV_COLOURS, LIGHT
from mdrive_sumo.report.render.canvas import fade
from mdrive_sumo.report.render.rings import Rings, build_rings
from mdrive_sumo.roads.drawing.map_geometry import MapGeometry
from mdrive_sumo.roads.drawing.road_paint import build_road_paint, widen_line
from mdrive_sumo.scenario.scenario import Ego

LINE_M, STOP_LINE_M, ROUTE_M = 0.15, 0.4, 0.35
"""[m] Least widths of markings, stop lines and routes on the ground."""
LINE_PX, STOP_LINE_PX, ROUTE_PX = 1.1, 2.0, 2.0
"""[px] Least widths on a picture from above."""
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
    paint = build_road_paint(geometry, line, stop)
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
    whole = shapely.union_all([*widen_line(xy, width), disc])
    return [part for part in shapely.get_parts(whole).tolist() if isinstance(part, shapely.Polygon)]
