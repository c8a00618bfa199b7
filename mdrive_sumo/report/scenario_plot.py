"""A picture of a scenario: the network around it, routes, starts and goals, buildings, signs and waiting traffic."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path as FilePath

import numpy as np
import shapely
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import PathPatch, Polygon, RegularPolygon
from matplotlib.path import Path
from shapely.geometry.base import BaseGeometry

from mdrive_sumo.core.geometry import Float, box_corners, build_polyline
from mdrive_sumo.report.actor_plot import draw_actors
from mdrive_sumo.roads import RoadMap
from mdrive_sumo.scenario.background import BackgroundVehicle
from mdrive_sumo.scenario.scenario import Ego, Scenario
from mdrive_sumo.vehicle.dynamics import MKZ_2017

COLOURS = ("#e4572e", "#2e86de", "#12a67c", "#9b5de5", "#f2a104", "#d6336c", "#0fa3b1", "#7a5230")
"""One colour a CAV, in the order of the scenario; they repeat after eight."""
GROUND, PAVEMENT, ASPHALT, PAINT, BUILDING, BUILDING_EDGE = (
    "#eef0ea",
    "#d5d6d1",
    "#787f88",
    "#f7f7f2",
    "#c9b79c",
    "#8d7b62",
)
MARGIN_M = 16.0
LEAST_VIEW_M = 60.0
INCHES = 9.0
"""Longer side of the picture."""


@dataclass(frozen=True, slots=True)
class _View:
    """What the picture shows [m]."""

    left: float
    low: float
    right: float
    high: float

    @property
    def size(self) -> tuple[float, float]:
        """Width and height [m]."""
        return self.right - self.left, self.high - self.low

    def holds(self, shape: BaseGeometry) -> bool:
        """Whether some of a shape can be seen."""
        return shape.intersects(shapely.box(self.left, self.low, self.right, self.high))


def save_scenario_plot(scenario: Scenario, roads: RoadMap, path: FilePath, dpi: int = 130) -> None:
    """Writes a PNG (or what the suffix of `path` says) of a scenario; `roads` is its network."""
    view = _view_of(scenario)
    figure, axes = _canvas(view)
    _draw_ground(axes, roads, view)
    _draw_markings(axes, roads, view)
    _draw_crossings(axes, roads)
    _draw_signs(axes, roads, view)
    _add(axes, (b for b in roads.building_shapes if view.holds(b)), BUILDING, 5, edge=BUILDING_EDGE)
    for vehicle in scenario.background.vehicles:
        _draw_background(axes, vehicle, roads)
    draw_actors(axes, scenario.actors, roads)
    for ego, colour in _coloured(scenario.egos):
        _draw_ego(axes, ego, colour)
    _draw_scale(axes, view)
    _write_captions(figure, scenario, roads)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=dpi)


def _coloured(egos: Sequence[Ego]) -> list[tuple[Ego, str]]:
    return [(ego, COLOURS[i % len(COLOURS)]) for i, ego in enumerate(egos)]


def _view_of(scenario: Scenario) -> _View:
    xy = np.concatenate([ego.xy for ego in scenario.egos])
    centre = (xy.min(0) + xy.max(0)) / 2
    half = np.maximum((xy.max(0) - xy.min(0)) / 2 + MARGIN_M, LEAST_VIEW_M / 2)
    half = np.maximum(half, half.max() * 0.45)  # neither a stripe nor a tower
    (left, low), (right, high) = centre - half, centre + half
    return _View(float(left), float(low), float(right), float(high))


def _canvas(view: _View) -> tuple[Figure, Axes]:
    width, height = view.size
    scale = INCHES / max(width, height)
    captions = 0.95  # inches, above and below
    total = height * scale + captions
    figure = Figure(figsize=(width * scale, total), facecolor="white")
    FigureCanvasAgg(figure)
    axes = figure.add_axes((0.0, 0.35 / total, 1.0, height * scale / total), facecolor=GROUND)
    axes.set(xlim=(view.left, view.right), ylim=(view.low, view.high), aspect="equal", xticks=[], yticks=[])
    for spine in axes.spines.values():
        spine.set_visible(False)
    return figure, axes


def _draw_ground(axes: Axes, roads: RoadMap, view: _View) -> None:
    """Pavements and asphalt."""
    lanes = [
        shapely.LineString(lane.centre.xy).buffer(lane.width / 2 + 0.05, cap_style="flat") for lane in roads.driving
    ]
    areas = [shapely.Polygon(outline).buffer(0.05) for outline in roads.junctions]
    near = [shape for shape in (*lanes, *areas) if view.holds(shape)]
    surface = shapely.union_all(near)
    _add(axes, [shapely.make_valid(shapely.Polygon(outline)) for outline in roads.pavements], PAVEMENT, 1)
    _add(axes, (surface,), ASPHALT, 2)


def _add(
    axes: Axes,
    shapes: Iterable[BaseGeometry],
    colour: str,
    order: float,
    edge: str = "none",
    alpha: float = 1.0,
) -> None:
    patches = [PathPatch(_outline(part)) for shape in shapes for part in _polygons(shape)]
    axes.add_collection(
        PatchCollection(patches, facecolor=colour, edgecolor=edge, linewidth=0.8, zorder=order, alpha=alpha)
    )


def _polygons(shape: BaseGeometry) -> list[shapely.Polygon]:
    return [part for part in shapely.get_parts(shape).tolist() if isinstance(part, shapely.Polygon)]


def _outline(polygon: shapely.Polygon) -> Path:
    """The polygon with its holes as one path."""
    rings = (polygon.exterior, *polygon.interiors)
    return Path.make_compound_path(*(Path(shapely.get_coordinates(ring), closed=True) for ring in rings))


def _draw_markings(axes: Axes, roads: RoadMap, view: _View) -> None:
    """Dashed lines between lanes of one direction, solid ones at both sides of the carriageway."""
    dashed: list[Float] = []
    solid: list[Float] = []
    for lane in roads.driving:
        if lane.junction or not view.holds(shapely.LineString(lane.centre.xy)):
            continue
        line = shapely.LineString(lane.centre.xy)
        (dashed if lane.left else solid).append(_beside(line, lane.width / 2 - (0.0 if lane.left else 0.12)))
        if not lane.right:
            solid.append(_beside(line, 0.12 - lane.width / 2))
    axes.add_collection(LineCollection(solid, colors=PAINT, linewidths=0.9, zorder=3))
    axes.add_collection(LineCollection(dashed, colors=PAINT, linewidths=0.9, linestyles=(0, (7, 6)), zorder=3))


def _beside(line: shapely.LineString, left_m: float) -> Float:
    return shapely.get_coordinates(line.offset_curve(left_m))


def _draw_crossings(axes: Axes, roads: RoadMap) -> None:
    """Zebra stripes."""
    for xy, width in roads.crossings:
        bars = [_bar(xy, s, width) for s in np.arange(0.5, build_polyline(xy).length, 1.0)]
        axes.add_collection(LineCollection(bars, colors=PAINT, linewidths=2.0, zorder=3))


def _bar(xy: Float, s: float, width: float) -> Float:
    line = build_polyline(xy)
    along = np.array((np.cos(line.yaw_at(s)), np.sin(line.yaw_at(s))))
    left = np.array((-along[1], along[0])) * width / 2
    return np.array((line.at(s) + left, line.at(s) - left))


def _draw_signs(axes: Axes, roads: RoadMap, view: _View) -> None:
    """Stop lines where a light or a stop sign asks for them, and the signs."""
    for lane in roads.driving:
        if lane.lights:
            _stop_line(axes, roads, lane.id, lane.centre.length, PAINT)
    for sign in roads.stop_signs or ():
        x, y = _stop_line(axes, roads, sign.lane, sign.line_pos_m, PAINT)
        if view.holds(shapely.Point(x, y)):
            axes.add_patch(RegularPolygon((x, y), 8, radius=1.5, facecolor="#c81e1e", edgecolor="white", zorder=6))
            axes.text(x, y, "STOP", color="white", fontsize=4.5, weight="bold", ha="center", va="center", zorder=7)


def _stop_line(axes: Axes, roads: RoadMap, lane_id: str, s: float, colour: str) -> tuple[float, float]:
    """Draws a stop line; returns the place of a sign to its right [m]."""
    lane = roads.lanes[lane_id]
    yaw = lane.centre.yaw_at(s - 0.1)
    centre, right = np.array(lane.centre.at(s)), np.array((np.sin(yaw), -np.cos(yaw)))
    ends = np.array((centre - right * (lane.width / 2 - 0.2), centre + right * (lane.width / 2 - 0.2)))
    axes.plot(ends[:, 0], ends[:, 1], color=colour, linewidth=2.4, zorder=3, solid_capstyle="butt")
    x, y = centre + right * (lane.width / 2 + 2.2)
    return float(x), float(y)


def _draw_background(axes: Axes, vehicle: BackgroundVehicle, roads: RoadMap) -> None:
    """A vehicle of SUMO's where it departs; its edge may be unknown to the map of car lanes."""
    lane = roads.lanes.get(f"{vehicle.edges[0]}_{vehicle.depart_lane}")
    if lane is not None:
        s = vehicle.depart_pos_m - vehicle.length / 2
        corners = box_corners(*lane.centre.at(s), lane.centre.yaw_at(s), vehicle.length, vehicle.width)
        axes.add_patch(Polygon(corners, facecolor="#3d4047", edgecolor="white", linewidth=0.6, zorder=8))


def _draw_ego(axes: Axes, ego: Ego, colour: str) -> None:
    xy = ego.xy
    axes.plot(xy[:, 0], xy[:, 1], color="white", linewidth=4.2, zorder=8, solid_capstyle="round", alpha=0.85)
    axes.plot(xy[:, 0], xy[:, 1], color=colour, linewidth=2.4, zorder=9, solid_capstyle="round")
    _draw_arrows(axes, xy, colour)
    _draw_flag(axes, xy[-1], colour)
    start = ego.start
    corners = box_corners(start.x, start.y, start.yaw, MKZ_2017.length, MKZ_2017.width)
    axes.add_patch(Polygon(corners, facecolor=colour, edgecolor="white", linewidth=1.0, zorder=11))
    nose = (corners[0] + corners[3]) / 2
    glass = np.array((corners[0] * 0.8 + corners[1] * 0.2, nose, corners[3] * 0.8 + corners[2] * 0.2))
    axes.add_patch(Polygon(glass, facecolor="white", alpha=0.75, zorder=12))
    axes.text(
        start.x,
        start.y,
        ego.id,
        color="white",
        fontsize=9,
        weight="bold",
        ha="center",
        va="center",
        zorder=13,
    )


def _draw_arrows(axes: Axes, xy: Float, colour: str) -> None:
    """Arrow heads every 10 m along a route."""
    for i in range(10, len(xy) - 3, 10):
        axes.annotate(
            "",
            xy=(float(xy[i + 1, 0]), float(xy[i + 1, 1])),
            xytext=(float(xy[i, 0]), float(xy[i, 1])),
            arrowprops={
                "arrowstyle": "-|>",
                "color": colour,
                "mutation_scale": 13,
                "shrinkA": 0,
                "shrinkB": 0,
            },
            zorder=10,
        )


def _draw_flag(axes: Axes, goal: Float, colour: str) -> None:
    """A flag whose pole stands on the goal."""
    x, y = float(goal[0]), float(goal[1])
    axes.plot([x, x], [y, y + 4.2], color="#222222", linewidth=1.6, zorder=12, solid_capstyle="round")
    cloth = np.array(((x, y + 4.2), (x + 3.2, y + 3.2), (x, y + 2.2)))
    axes.add_patch(Polygon(cloth, facecolor=colour, edgecolor="#222222", linewidth=0.8, zorder=12))
    axes.plot([x], [y], marker="o", markersize=4.5, color=colour, markeredgecolor="#222222", zorder=12)


def _draw_scale(axes: Axes, view: _View) -> None:
    width, height = view.size
    length = 10.0 if width < 90 else 20.0 if width < 200 else 50.0
    x, y = view.right - 0.03 * width - length, view.low + 0.035 * height
    axes.plot([x, x + length], [y, y], color="black", linewidth=3, solid_capstyle="butt", zorder=14)
    axes.text(x + length / 2, y + 0.012 * height, f"{length:.0f} m", ha="center", fontsize=8, zorder=14)


def _write_captions(figure: Figure, scenario: Scenario, roads: RoadMap) -> None:
    height = float(figure.get_figheight())
    known = f"{scenario.category} · {roads.name} · {len(scenario.egos)} CAVs · signals {scenario.signals}"
    figure.text(0.012, 1 - 0.22 / height, scenario.id, weight="bold", fontsize=12, va="center")
    figure.text(0.988, 1 - 0.22 / height, known, fontsize=8.5, va="center", ha="right", color="#444444")
    figure.text(0.012, 1 - 0.45 / height, scenario.description, fontsize=8.5, va="center", color="#444444")
    for i, (ego, colour) in enumerate(_coloured(scenario.egos)):
        x = 0.012 + 0.976 * i / max(len(scenario.egos), 6)
        length = build_polyline(ego.xy).length
        figure.text(
            x,
            0.17 / height,
            f"■ {ego.id}: {length:.0f} m",
            color=colour,
            fontsize=9,
            weight="bold",
            va="center",
        )
