"""Draw a road network with matplotlib: surfaces, markings, crossings, signs and buildings."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.patches import PathPatch, RegularPolygon
from matplotlib.path import Path
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Float, build_polyline
from mdrive_sumo.report.palette import LIGHT
from mdrive_sumo.roads import RoadMap

GROUND, PAVEMENT, ASPHALT, PAINT = (LIGHT[name] for name in ("ground", "footway", "road", "line"))
BUILDING, BUILDING_EDGE = LIGHT["building"], LIGHT["building-edge"]


@dataclass(frozen=True, slots=True)
class MapView:
    """The rectangle that a plot shows [m]."""

    left: float
    low: float
    right: float
    high: float

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [m]."""
        return self.right - self.left, self.high - self.low

    def contains(self, shape: BaseGeometry) -> bool:
        """Return whether a part of the shape is visible."""
        return shape.intersects(shapely.box(self.left, self.low, self.right, self.high))


def fit_view(xy: Float, margin_m: float = 16.0, min_side_m: float = 60.0) -> MapView:
    """Return a view around points (N, 2) [m] with a margin; neither side is shorter than 45 % of the other."""
    centre = (xy.min(0) + xy.max(0)) / 2
    half = np.maximum((xy.max(0) - xy.min(0)) / 2 + margin_m, min_side_m / 2)
    half = np.maximum(half, half.max() * 0.45)
    (left, low), (right, high) = centre - half, centre + half
    return MapView(float(left), float(low), float(right), float(high))


def draw_map(axes: Axes, roads: RoadMap, view: MapView) -> None:
    """Draw everything of the network that is visible in the view, and fit the axes to the view."""
    axes.set_facecolor(GROUND)
    axes.set(xlim=(view.left, view.right), ylim=(view.low, view.high), aspect="equal", xticks=[], yticks=[])
    axes.spines[:].set_visible(False)
    _draw_surfaces(axes, roads, view)
    _draw_markings(axes, roads, view)
    _draw_crossings(axes, roads)
    _draw_signs(axes, roads, view)
    _add_shapes(axes, (b for b in roads.building_shapes if view.contains(b)), BUILDING, 5, edge=BUILDING_EDGE)


def _draw_surfaces(axes: Axes, roads: RoadMap, view: MapView) -> None:
    """Draw pavements and asphalt."""
    lanes = [
        shapely.LineString(lane.centre.xy).buffer(lane.width / 2 + 0.05, cap_style="flat") for lane in roads.driving
    ]
    areas = [shapely.Polygon(outline).buffer(0.05) for outline in roads.junctions]
    near = [shape for shape in (*lanes, *areas) if view.contains(shape)]
    surface = shapely.union_all(near)
    _add_shapes(axes, [shapely.make_valid(shapely.Polygon(outline)) for outline in roads.pavements], PAVEMENT, 1)
    _add_shapes(axes, (surface,), ASPHALT, 2)


def _add_shapes(
    axes: Axes,
    shapes: Iterable[BaseGeometry],
    colour: str,
    order: float,
    edge: str = "none",
    alpha: float = 1.0,
) -> None:
    patches = [PathPatch(_make_path(part)) for shape in shapes for part in _find_polygons(shape)]
    axes.add_collection(
        PatchCollection(patches, facecolor=colour, edgecolor=edge, linewidth=0.8, zorder=order, alpha=alpha)
    )


def _find_polygons(shape: BaseGeometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(shape).tolist() if isinstance(part, shapely.Polygon)]


def _make_path(polygon: shapely.Polygon) -> Path:
    """Return a polygon with its holes as one path."""
    rings = (polygon.exterior, *polygon.interiors)
    return Path.make_compound_path(*(Path(shapely.get_coordinates(ring), closed=True) for ring in rings))


def _draw_markings(axes: Axes, roads: RoadMap, view: MapView) -> None:
    """Draw dashed lines between lanes of one direction, and solid ones at both sides of the carriageway."""
    dashed: list[Float] = []
    solid: list[Float] = []
    for lane in roads.driving:
        if lane.junction or not view.contains(shapely.LineString(lane.centre.xy)):
            continue
        line = shapely.LineString(lane.centre.xy)
        (dashed if lane.left else solid).append(_offset(line, lane.width / 2 - (0.0 if lane.left else 0.12)))
        if not lane.right:
            solid.append(_offset(line, 0.12 - lane.width / 2))
    axes.add_collection(LineCollection(solid, colors=PAINT, linewidths=0.9, zorder=3))
    axes.add_collection(LineCollection(dashed, colors=PAINT, linewidths=0.9, linestyles=(0, (7, 6)), zorder=3))


def _offset(line: shapely.LineString, left_m: float) -> Float:
    return shapely.get_coordinates(line.offset_curve(left_m))


def _draw_crossings(axes: Axes, roads: RoadMap) -> None:
    """Draw zebra crossings."""
    for xy, width in roads.crossings:
        bars = [_compute_bar(xy, s, width) for s in np.arange(0.5, build_polyline(xy).length, 1.0)]
        axes.add_collection(LineCollection(bars, colors=PAINT, linewidths=2.0, zorder=3))


def _compute_bar(xy: Float, s: float, width: float) -> Float:
    line = build_polyline(xy)
    along = np.array((np.cos(line.yaw_at(s)), np.sin(line.yaw_at(s))))
    left = np.array((-along[1], along[0])) * width / 2
    return np.array((line.at(s) + left, line.at(s) - left))


def _draw_signs(axes: Axes, roads: RoadMap, view: MapView) -> None:
    """Draw the stop lines of traffic lights and stop signs, and the signs."""
    for lane in roads.driving:
        if lane.lights:
            _draw_stop_line(axes, roads, lane.id, lane.centre.length, PAINT)
    for sign in roads.stop_signs or ():
        x, y = _draw_stop_line(axes, roads, sign.lane, sign.line_pos_m, PAINT)
        if view.contains(shapely.Point(x, y)):
            axes.add_patch(RegularPolygon((x, y), 8, radius=1.5, facecolor="#c81e1e", edgecolor="white", zorder=6))
            axes.text(x, y, "STOP", color="white", fontsize=4.5, weight="bold", ha="center", va="center", zorder=7)


def _draw_stop_line(axes: Axes, roads: RoadMap, lane_id: str, s: float, colour: str) -> tuple[float, float]:
    """Draw a stop line and return the position (x, y) [m] of a sign to its right."""
    lane = roads.lanes[lane_id]
    yaw = lane.centre.yaw_at(s - 0.1)
    centre, right = np.array(lane.centre.at(s)), np.array((np.sin(yaw), -np.cos(yaw)))
    ends = np.array((centre - right * (lane.width / 2 - 0.2), centre + right * (lane.width / 2 - 0.2)))
    axes.plot(ends[:, 0], ends[:, 1], color=colour, linewidth=2.4, zorder=3, solid_capstyle="butt")
    x, y = centre + right * (lane.width / 2 + 2.2)
    return float(x), float(y)
