"""Draw the geometry of a road network with matplotlib: surfaces, markings, crossings, signs and buildings."""

from collections.abc import Iterable

import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.patches import PathPatch, RegularPolygon
from matplotlib.path import Path

from mdrive_sumo.core.geometry import Float
from mdrive_sumo.report.map_view import MapView
from mdrive_sumo.report.palette import LIGHT
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.roads.drawing.map_geometry import MapGeometry, build_map_geometry

GROUND, PAVEMENT, APRON, ASPHALT, PAINT = (LIGHT[name] for name in ("ground", "footway", "apron", "road", "line"))
BUILDING, BUILDING_EDGE = LIGHT["building"], LIGHT["building-edge"]


def draw_map(axes: Axes, roads: RoadMap, view: MapView) -> None:
    """Draw everything of the network that is visible in the view, and fit the axes to the view."""
    axes.set_facecolor(GROUND)
    axes.set(xlim=(view.left, view.right), ylim=(view.low, view.high), aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    geometry = build_map_geometry(roads, view.box)
    _add_shapes(axes, geometry.pavements, PAVEMENT, 1)
    _add_shapes(axes, geometry.aprons, APRON, 1.5)
    _add_shapes(axes, geometry.asphalt, ASPHALT, 2)
    _add_shapes(axes, geometry.stripes, PAINT, 2.5)
    _add_lines(axes, geometry.markings.solid, 0.9)
    _add_lines(axes, geometry.markings.dashed, 0.9, (0, (7, 6)))
    _draw_stops(axes, geometry, view)
    _add_shapes(axes, geometry.buildings, BUILDING, 5, edge=BUILDING_EDGE)


def _add_shapes(axes: Axes, shapes: Iterable[shapely.Polygon], colour: str, order: float, edge: str = "none") -> None:
    patches = [PathPatch(_make_path(shape)) for shape in shapes]
    axes.add_collection(PatchCollection(patches, facecolor=colour, edgecolor=edge, linewidth=0.8, zorder=order))


def _make_path(polygon: shapely.Polygon) -> Path:
    """Return a polygon with its holes as one path."""
    rings = (polygon.exterior, *polygon.interiors)
    return Path.make_compound_path(*(Path(shapely.get_coordinates(ring), closed=True) for ring in rings))


def _add_lines(
    axes: Axes, lines: Iterable[Float], width: float, style: str | tuple[int, tuple[int, int]] = "solid"
) -> None:
    axes.add_collection(LineCollection(list(lines), colors=PAINT, linewidths=width, linestyles=style, zorder=3))


def _draw_stops(axes: Axes, geometry: MapGeometry, view: MapView) -> None:
    """Draw the stop lines of traffic lights and stop signs, and the signs."""
    marks = (*geometry.stop_signs, *geometry.light_stops)
    _add_lines(axes, (mark.line for mark in marks), 2.4)
    for mark in marks:
        if mark.sign is not None and view.contains(shapely.Point(mark.sign)):
            x, y = mark.sign.tolist()
            axes.add_patch(RegularPolygon((x, y), 8, radius=1.5, facecolor=LIGHT["bad"], edgecolor="white", zorder=6))
            axes.text(x, y, "STOP", color="white", fontsize=4.5, weight="bold", ha="center", va="center", zorder=7)
